"""Implements `evis events convert`, which writes a recording in another format."""

from __future__ import annotations

import argparse
from collections import Counter
from typing import TYPE_CHECKING, Any

from evis.cli.events.files import (
    add_input,
    add_output,
    add_part,
    blocks_of,
    check_output,
    colourless,
    counted_from_zero,
    holds_whole_us,
    open_input,
    percent,
    rounded,
)

if TYPE_CHECKING:
    from evis.events import Events

HELP = "write a recording in another format"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the action's arguments."""
    add_input(parser, "source", "IN")
    add_output(parser)
    add_part(parser)
    parser.add_argument("--rebase", action="store_true", help="let the times count from the first one")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Copies a recording block by block."""
    from evis.events import open_writer

    check_output(args.out, args.encoding)
    counts: Counter[str] = Counter(events=0)
    with open_input(args, args.source) as recording, percent(recording, "converting") as step:
        about = recording.info
        if not about.width:
            raise ValueError(f"{args.source}: holds no events and no sensor size; there is nothing to convert")
        shift = (recording.next_t_ns or 0) + round(args.start * 1e9) if args.rebase else 0
        with (
            counted_from_zero(args.rebase),
            open_writer(args.out, about.width, about.height, args.encoding) as writer,
        ):
            for events in blocks_of(recording, args):
                if shift:
                    _shift(events, shift)
                writer.write(events)
                counts["events"] += len(events)
                counts["times_rounded_to_us"] += rounded(events) if holds_whole_us(args.out) else 0
                counts["colour_left_out"] += colourless(events, args.out)
                for name, n in (
                    ("triggers", len(events.triggers)),
                    ("imu", len(events.imu)),
                    ("frames", len(events.frames)),
                ):
                    counts[name if name in writer.keeps else f"{name}_left_out"] += n
                step()
        lost = recording.counters()
    result: dict[str, Any] = {"out": args.out, "events": counts.pop("events"), **lost}
    result |= {name: n for name, n in counts.items() if n}
    if about.truncated:
        result["truncated"] = True
    warnings = list(about.warnings)
    if args.out.lower().endswith((".csv", ".txt")) and about.geometry_from != "events":
        warnings.append(f"text has no sensor size; say --size {about.width}x{about.height} to what reads it")
    return result | ({"warnings": warnings} if warnings else {})


def _shift(events: Events, ns: int) -> None:
    events.t, events.triggers.t, events.imu.t = events.t - ns, events.triggers.t - ns, events.imu.t - ns
    for frame in events.frames:
        frame.t_ns, frame.end_ns = frame.t_ns - ns, frame.end_ns - ns
        frame.exposure_start_ns, frame.exposure_end_ns = frame.exposure_start_ns - ns, frame.exposure_end_ns - ns
