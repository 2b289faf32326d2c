"""Declares the options of `evis events simulate` for frames: which part of them, in which size, and what goes between
them."""

from __future__ import annotations

import argparse
import re
from typing import TYPE_CHECKING

from evis.cli.events.files import rectangle, size
from evis.cli.parser import UsageError
from evis.config.suggestions import nearest
from nodes.event_sensor.presets import PRESETS

if TYPE_CHECKING:
    from evis.media.frames.selection import Selection
    from nodes.interpolator.video.upsample import Upsampler

SENSORS = {key: (preset.width, preset.height) for key, preset in PRESETS.items() if preset.width}


def add_frame_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options for frames, from --colour to --interpolator."""
    group = parser.add_argument_group("frames", "docs/video.md has an example of each")
    group.add_argument("--colour", action="store_true", help="a sensor for each of R, G and B (OUT .npz keeps which)")
    group.add_argument("--fps", type=float, metavar="HZ", help="frames per second, instead of the times in the files")
    group.add_argument(
        "--slow-motion", type=float, default=1.0, metavar="N",
        help="the source plays N times slower than the scene was: times are divided by N (1)",
    )  # fmt: skip
    group.add_argument(
        "--from",
        type=_seconds,
        default=0,
        dest="start",
        metavar="S",
        help="seconds from its first frame on",
    )
    group.add_argument("--to", type=_seconds, dest="stop", metavar="S", help="likewise; not included")
    group.add_argument("--crop", type=rectangle, metavar="X,Y,W,H", help="a rectangle of the source's pixels")
    sensors = ", ".join(SENSORS)
    group.add_argument(
        "--size", type=_size, metavar="WxH", help=f"of the sensor; also a sensor's name ({sensors}), or `preset`: that "
        "of --preset"
    )  # fmt: skip
    group.add_argument("--width", type=int, metavar="PX", help="of the sensor; alone, proportions are kept")
    group.add_argument("--height", type=int, metavar="PX", help="likewise")
    group.add_argument(
        "--tone", metavar="CURVE",
        help="how images and video (EXR is linear) code radiance: srgb (IEC 61966-2-1), linear, gamma:G, or pq and hlg "
        "(ITU-R BT.2100); unless given, that of which a video tells, or srgb",
    )  # fmt: skip
    group.add_argument("--white", type=float, metavar="I", help="radiance of full scale in them (1)")
    group.add_argument(
        "--upsample", type=_upsample, default=1, metavar="N",
        help="frames made between frames along optical flow: auto, as many as keep the motion below a pixel; N, so "
        "many per gap, the later frame included; none (none)",
    )  # fmt: skip
    group.add_argument(
        "--interpolator", metavar="MODULE:CLASS", help="a class of your own that makes them, named as nodes are"
    )
    group.add_argument(
        "--save-frames", metavar="DIR", help="write the frames that the sensor takes, those between included, as EXR"
    )


def selection_of(args: argparse.Namespace) -> Selection:
    """Gives the part that the options ask for. Raises UsageError."""
    from evis.media.frames.selection import Selection

    width, height = args.width, args.height
    if args.size is not None:
        if width is not None or height is not None:
            raise UsageError("--size says both sides; leave out --width and --height")
        width, height = _preset_size(args.preset) if args.size == "preset" else args.size
    chosen = Selection(args.crop, width, height, args.start, args.stop, args.slow_motion)
    try:
        chosen.check()
    except ValueError as error:
        raise UsageError(f"--{error}") from None
    return chosen


def upsampler_of(args: argparse.Namespace) -> Upsampler | None:
    """Makes the upsampler that the options ask for, None where they ask for none. Raises UsageError."""
    frames: int | None = args.upsample
    if frames == 1:
        if args.interpolator is not None:
            raise UsageError(f"--interpolator {args.interpolator} has no effect without --upsample auto or N")
        return None
    from nodes.interpolator.video.between import load_interpolator
    from nodes.interpolator.video.upsample import Upsampler

    try:
        own = None if args.interpolator is None else load_interpolator(args.interpolator)
        return Upsampler(frames, own)
    except ValueError as error:
        raise UsageError(f"{error}") from None


def _preset_size(preset: str) -> tuple[int, int]:
    if preset not in SENSORS:
        raise UsageError(f"--size preset: preset {preset} is no sensor with a size; {', '.join(SENSORS)} are")
    return SENSORS[preset]


def _seconds(text: str) -> int:
    """Seconds -> ns."""
    try:
        return round(float(text) * 1e9)
    except (ValueError, OverflowError):
        raise argparse.ArgumentTypeError(f"'{text}' is no time in seconds") from None


def _size(text: str) -> tuple[int, int] | str:
    if text == "preset":
        return text
    if re.match(r"\d+x", text):
        return size(text)
    if text not in SENSORS:
        raise argparse.ArgumentTypeError(f"'{text}' is no size and no sensor; {nearest(text, ('preset', *SENSORS))}")
    return SENSORS[text]


def _upsample(text: str) -> int | None:
    """auto -> None, none -> 1."""
    if text in ("auto", "none"):
        return None if text == "auto" else 1
    if not re.fullmatch(r"\d{1,6}", text) or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' must be auto, none or a number of frames per gap")
    return int(text)
