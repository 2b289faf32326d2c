"""`evis events convert`: a recording in another format."""

from __future__ import annotations

import argparse
from typing import Any

from evis.cli.events.files import add_output, is_raw, percent, rounded

HELP = "write a recording in another format: .raw, .npz, .csv or .txt"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the action's arguments."""
    parser.add_argument("source", metavar="IN", help="a .raw or .npz recording")
    add_output(parser)
    parser.add_argument("--rebase", action="store_true", help="let the times count from the first one")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Copy block by block."""
    from evis.streams import open_recording, open_writer

    n = off_grid = triggers = 0
    with open_recording(args.source) as recording, percent(recording, "converting") as step:
        about = recording.info
        if not about.width:
            raise ValueError(f"{args.source}: holds no events and no sensor size; there is nothing to convert")
        shift = (recording.next_t_ns or 0) if args.rebase else 0
        raw = is_raw(args.out)
        with open_writer(args.out, about.width, about.height, args.encoding) as writer:
            for events in recording.blocks():
                if shift:
                    events.t, events.triggers.t = events.t - shift, events.triggers.t - shift
                writer.write(events)
                n, triggers = n + len(events), triggers + len(events.triggers)
                off_grid += rounded(events) if raw else 0
                step()
        lost = recording.counters()
    result: dict[str, Any] = {"out": args.out, "events": n, **lost}
    if off_grid:
        result["times_rounded_to_us"] = off_grid
    if triggers:
        result["triggers" if raw else "triggers_left_out"] = triggers
    return result
