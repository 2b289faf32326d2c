"""Implements `evis events convert`, which writes a recording, or a part of it, in another format."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from evis.cli.events.files import add_input, add_output, add_part, blocks_of, check_output, open_input, rectangle
from evis.cli.events.losses import colourless, counted_from_zero, holds_whole_us, rounded
from evis.cli.events.progress import percent
from evis.cli.numbers import number_up_to
from evis.cli.parser import UsageError

if TYPE_CHECKING:
    from evis.events import Events, RecordingInfo

HELP = "write a recording, or a part of it, in another format"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the action's arguments."""
    add_input(parser, "source", "IN")
    add_output(parser)
    add_part(parser)
    parser.add_argument("--rebase", action="store_true", help="let the times count from the first one")
    group = parser.add_argument_group("a part of the events", "docs/cameras.md tells more under Recordings")
    group.add_argument(
        "--crop",
        type=rectangle,
        metavar="X,Y,W,H",
        help="a rectangle of pixels, which is the sensor of what is written",
    )
    group.add_argument("--polarity", choices=["on", "off"], help="events of one polarity")
    group.add_argument(
        "--denoise",
        type=number_up_to(1e9, "is no time in ms"),
        metavar="MS",
        help="events only where one of the eight neighbours had one at most MS before: without lone ones, as noise is",
    )


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Copies a recording block by block."""
    from evis.events import open_writer

    check_output(args.out, args.encoding)
    counts: Counter[str] = Counter(events=0)
    with open_input(args, args.source) as recording, percent(recording, "converting") as step:
        about = recording.info
        if not about.width:
            raise ValueError(f"{args.source}: holds no events and no sensor size; there is nothing to convert")
        choose, (width, height) = _chosen(args, about, counts)
        shift = (recording.next_t_ns or 0) + round(args.start * 1e9) if args.rebase else 0
        with (
            counted_from_zero(args.rebase),
            open_writer(args.out, width, height, args.encoding) as writer,
        ):
            for block in blocks_of(recording, args):
                events = choose(block)
                events = events.shifted(-shift) if shift else events
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
    if args.out.lower().endswith((".csv", ".txt")) and (args.crop or about.geometry_from != "events"):
        warnings.append(f"text has no sensor size; say --size {width}x{height} to what reads it")
    return result | ({"warnings": warnings} if warnings else {})


def _chosen(
    args: argparse.Namespace, about: RecordingInfo, counts: Counter[str]
) -> tuple[Callable[[Events], Events], tuple[int, int]]:
    """Gives what picks the wanted events of the next block and counts the others, and the size of their sensor [px]."""
    if args.crop is None and args.polarity is None and args.denoise is None:
        return lambda events: events, (about.width, about.height)
    from evis.events.filters import ActivityFilter, cropped
    from evis.events.filters.crop import check_rectangle
    from evis.events.recording import RecordingError
    from evis.files.damage import faults_as

    crop = args.crop or (0, 0, about.width, about.height)
    try:
        check_rectangle(crop, about.width, about.height)
    except ValueError as error:
        raise UsageError(f"--{error}") from None
    with faults_as(RecordingError, args.source):
        quiet = args.denoise and ActivityFilter(about.width, about.height, max(round(args.denoise * 1e6), 1))

    def counted(events: Events, kept: Events, reason: str) -> Events:
        counts[reason] += len(events) - len(kept)
        counts["frames_outside_crop"] += len(events.frames) - len(kept.frames)
        return kept

    def choose(events: Events) -> Events:
        # First by the neighbours, which a rectangle cuts off at its sides, and a polarity leaves half of.
        if quiet:
            events = counted(events, quiet(events), "noise_left_out")
        if args.crop is not None:
            events = counted(events, cropped(events, crop), "outside_crop")
        if args.polarity is not None:
            one = events[events.p == (args.polarity == "on")].beside(events)
            events = counted(events, one, f"{'off' if args.polarity == 'on' else 'on'}_left_out")
        return events

    return choose, crop[2:]
