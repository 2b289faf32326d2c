"""Implements `evis events render`, which draws a recording as pictures."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Any

from evis.cli.events.files import add_input, open_input
from evis.cli.events.progress import percent
from evis.cli.parser import UsageError

HELP = "draw a recording: an animation (.gif, .mp4) or a sheet of pictures (.png)"
MAX_PICTURES = 3000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the action's arguments."""
    add_input(parser)
    parser.add_argument("out", metavar="OUT", help="a file to write: .gif, .mp4 or .png")
    parser.add_argument(
        "--style",
        choices=["polarity", "time-surface"],
        default="polarity",
        help="polarity (default): the last event of each pixel in a window; time-surface: all events, fading with age",
    )
    parser.add_argument("--dt", type=float, default=20.0, metavar="MS", help="window of one picture (20)")
    parser.add_argument("--tau", type=float, metavar="MS", help="time surface: age at which 1/e is left (30)")
    parser.add_argument(
        "--from", type=float, default=0.0, dest="start", metavar="S", help="seconds after the first event or sample"
    )
    parser.add_argument("--to", type=float, dest="stop", metavar="S", help="likewise")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Draws a recording window by window."""
    from evis.events import RecordingError
    from evis.events.pixel_limit import check_pixels
    from evis.files.damage import faults_as
    from evis.media.pictures.event_pictures import TimeSurface, draw, windows
    from evis.media.pictures.writer import save_gif, save_mp4, save_sheet

    savers = {".gif": save_gif, ".mp4": save_mp4, ".png": save_sheet}
    save = next((s for end, s in savers.items() if args.out.lower().endswith(end)), None)
    if save is None:
        raise UsageError(f"{args.out}: can draw {', '.join(savers)}")
    surface_wanted = args.style == "time-surface"
    _check(args, surface_wanted)
    dt_ns, from_ns = round(args.dt * 1e6), round(args.start * 1e9)
    to_ns = None if args.stop is None else round(args.stop * 1e9)
    count = 0
    with open_input(args, args.recording) as recording, percent(recording, "drawing") as step:
        about = recording.info
        with faults_as(RecordingError, args.recording):
            check_pixels(about.width, about.height)
        first_ns = recording.next_t_ns or 0
        surface = TimeSurface(about.width, about.height, round((args.tau or 30.0) * 1e6)) if surface_wanted else None

        def pictures() -> Iterator[tuple[int, Any]]:
            nonlocal count
            for start, events in windows(recording, dt_ns, from_ns, to_ns):
                if count == MAX_PICTURES:
                    raise ValueError(f"more than {MAX_PICTURES} pictures; choose a longer --dt or an earlier --to")
                count += 1
                step()
                if surface is None:
                    yield start, draw(events, about.width, about.height)
                else:
                    yield start, surface.draw(events, first_ns + start + dt_ns)

        save(args.out, pictures(), args.dt)
    return {"out": args.out, "pictures": count, "width": about.width, "height": about.height}


def _check(args: argparse.Namespace, surface: bool) -> None:
    if not 0.001 <= args.dt <= 1e6:
        raise UsageError(f"--dt is {args.dt:g} ms, must be 0.001 to 1000000")
    if args.tau is not None and not surface:
        raise UsageError("--tau goes with --style time-surface")
    if args.tau is not None and not 0.001 <= args.tau <= 1e6:
        raise UsageError(f"--tau is {args.tau:g} ms, must be 0.001 to 1000000")
    if not 0 <= args.start <= 1e9 or (args.stop is not None and not args.start < args.stop <= 1e9):
        raise UsageError("--from and --to are seconds after the recording's start, --from below --to")
