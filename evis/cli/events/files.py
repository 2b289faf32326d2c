"""Declares and reads the arguments for a recording, a part of it, and a file to write, as actions share them."""

from __future__ import annotations

import argparse
import os
import re
import threading
from collections.abc import Iterator
from typing import TYPE_CHECKING

from evis.cli.numbers import number_up_to
from evis.cli.parser import UsageError

if TYPE_CHECKING:
    from evis.events import Events, Recording


ENDING = threading.Event()
"""Ctrl-C or SIGTERM came. Their exception is lost where it meets a destructor or a callback from C; this is not."""
OUTPUTS = ".raw, .npz, .csv, .txt, .dat, .es, .aedat4, .h5 or .hdf5"
_SECONDS = number_up_to(1e9, "is no time in seconds after the first event", zero=True)
STEP_NS = 20_000_000
"""What is read at a time of a part of a recording [ns]."""
_ENCODINGS = {
    ".raw": ("evt3", "evt4", "evt21", "evt21_legacy", "evt2"),
    ".aedat4": ("zstd", "lz4", "none"),
    ".h5": ("ecf", "plain", "dsec"),
    ".hdf5": ("ecf", "plain", "dsec"),
}


def add_input(parser: argparse.ArgumentParser, name: str = "recording", metavar: str = "REC") -> None:
    """Adds the arguments for a recording, and for what the user may say about it."""
    parser.add_argument(name, metavar=metavar, help="a recording in any format; its content decides which")
    add_stream(parser, "of a file with several event streams (the first)")


def add_stream(parser: argparse.ArgumentParser, which: str) -> None:
    """Adds --topic, of which `which` tells what it names, and --size."""
    parser.add_argument("--topic", default="", metavar="NAME", help=which)
    parser.add_argument("--size", type=size, metavar="WxH", help="of the sensor, in place of what the file says")


def add_part(parser: argparse.ArgumentParser) -> None:
    """Adds --from and --to."""
    parser.add_argument(
        "--from", type=_SECONDS, default=0.0, dest="start", metavar="S", help="seconds after the first event or sample"
    )
    parser.add_argument("--to", type=_SECONDS, dest="stop", metavar="S", help="likewise; not included")


def blocks_of(recording: Recording, args: argparse.Namespace) -> Iterator[Events]:
    """Yields the events of a recording, or of the part that `add_part` describes.

    Raises UsageError; once ENDING, KeyboardInterrupt.
    """
    for events in _part_of(recording, args):
        if ENDING.is_set():
            raise KeyboardInterrupt
        yield events


def _part_of(recording: Recording, args: argparse.Namespace) -> Iterator[Events]:
    if args.stop is not None and args.stop <= args.start:
        raise UsageError(f"--from {args.start:g} --to {args.stop:g}: the end must be later than the start")
    first = recording.next_t_ns
    if first is None or (not args.start and args.stop is None):
        yield from recording.blocks()
        return
    begin = None
    if args.start:
        begin = first + round(args.start * 1e9)
        recording.seek(begin)
    if args.stop is None:
        for events in recording.blocks():
            yield events.beside(events.aside(begin, None))
        return
    end = first + round(args.stop * 1e9)
    while (following := recording.next_t_ns) is not None and following < end:
        events = recording.read_until(min(following + STEP_NS, end) - 1)
        yield events.beside(events.aside(begin, end))
    yield recording.read_aside(end - 1).aside(begin, end)


def size(text: str) -> tuple[int, int]:
    """Parses a size: `640x480` -> (640, 480)."""
    found = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text)
    if not found or not (0 < int(found[1]) < 65536 and 0 < int(found[2]) < 65536):
        raise argparse.ArgumentTypeError(f"'{text}' is no size; write it as 640x480")
    return int(found[1]), int(found[2])


def rectangle(text: str) -> tuple[int, int, int, int]:
    """Parses a rectangle of pixels: `100,50,640,480` -> x, y, width, height."""
    found = re.fullmatch(r"(\d{1,6}),(\d{1,6}),(\d{1,6}),(\d{1,6})", text.replace(" ", ""))
    if found is None:
        raise argparse.ArgumentTypeError(
            f"'{text}' is no rectangle; write x,y,width,height in pixels, as 100,50,640,480"
        )
    x, y, width, height = map(int, found.groups())
    return x, y, width, height


def open_input(args: argparse.Namespace, path: str) -> Recording:
    """Opens the recording that `add_input` describes."""
    from evis.events import open_recording

    return open_recording(path, size=args.size, topic=args.topic)


def add_output(parser: argparse.ArgumentParser) -> None:
    """Adds OUT and --encoding."""
    parser.add_argument("out", metavar="OUT", help=f"a file to write: {OUTPUTS}")
    parser.add_argument(
        "--encoding",
        default="",
        metavar="NAME",
        help="of .raw: evt3 (default), evt4, evt21, evt21_legacy, evt2; of .aedat4: zstd (default), lz4, none; of .h5 "
        "and .hdf5: ecf (default) or plain, as Prophesee has it, or dsec, with ms_to_idx",
    )


def check_output(path: str, encoding: str) -> None:
    """Raises UsageError unless OUT is written in a known format that has the encoding."""
    suffix = os.path.splitext(path)[1].lower()
    if suffix not in OUTPUTS.replace(" or", ",").split(", "):
        bag = f"; `evis launch camera file:=RECORDING pace:=fast --record {path}` makes a bag of a recording"
        what = f"cannot write '{suffix}'" if suffix else "no extension says what to write"
        raise UsageError(f"{path}: {what}; the extensions are {OUTPUTS}{bag if suffix == '.mcap' else ''}")
    known = _ENCODINGS.get(suffix, ())
    if encoding and encoding not in known:
        there = f"there are {', '.join(known)}" if known else "leave out --encoding"
        raise UsageError(f"{path}: {suffix} has no encoding '{encoding}'; {there}")
