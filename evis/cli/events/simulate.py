"""Implements `evis events simulate`, which runs the event sensor on frames from anywhere."""

from __future__ import annotations

import argparse
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from evis.cli.events.files import add_output, check_output
from evis.cli.events.frame_options import add_frame_options, selection_of, upsampler_of
from evis.cli.events.losses import colourless, holds_whole_us, rounded
from evis.cli.events.progress import counted
from evis.cli.events.saved_frames import SavedFrames
from evis.cli.events.sensor_options import add_sensor_options, check_sensor_options, sensor_values
from evis.cli.parser import UsageError

if TYPE_CHECKING:
    from evis.cli.events.coding import Coding
    from evis.media.frames.selection import Selection
    from evis.media.frames.source import FrameBlock, FrameOptions, FrameSource
    from nodes.event_sensor.simulate import Simulation
    from nodes.interpolator.video.upsample import Upsampler

HELP = "events from frames: an .npz, a folder of images, or a video"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the action's arguments."""
    parser.add_argument(
        "source",
        metavar="FRAMES",
        help="an .npz of luminance (float32 [T,H,W], linear) and t (int64 [T], ns), optionally dlog_dt, or rgb in "
        "place of luminance; a folder, or a pattern in quotes, of EXR (linear), PNG, JPEG, TIFF, BMP "
        "or PGM; or a video",
    )
    add_output(parser)
    parser.add_argument("--rebase", action="store_true", help="let the times count from the first frame")
    add_frame_options(parser)
    add_sensor_options(parser)


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Reads, simulates and writes block by block."""
    from evis.cli.events.coding import Coding
    from evis.events import open_writer
    from evis.gpu.devices import device_named
    from evis.media.frames.source import FrameOptions
    from nodes.event_sensor.parameters import thresholds_of
    from nodes.event_sensor.simulate import Simulation

    if os.path.exists(args.source) and os.path.exists(args.out) and os.path.samefile(args.source, args.out):
        raise UsageError(f"{args.out} holds the frames and would be lost; write another file")
    check_output(args.out, args.encoding)
    if not 0 <= args.seed < 2**63:
        raise UsageError(f"--seed is {args.seed}; it must be 0 to 2^63 - 1")
    chosen = selection_of(args)
    options = FrameOptions(args.colour, args.crossing == "hermite", args.fps, args.tone, args.white, ends=True)
    try:
        options.check()
        options.make_tone()
    except ValueError as error:
        raise UsageError(f"--{error}") from None
    device_named(args.device)  # before any work, as a device may not be there
    try:
        check_sensor_options(args)
        simulation = Simulation(preset=args.preset, seed=args.seed, device=args.device, **sensor_values(args))
        simulation.check(args.colour)
    except ValueError as error:
        raise UsageError(str(error)) from None
    upsampler = upsampler_of(args)
    known = simulation.parameters
    hermite = known["crossing"] == "hermite"
    if hermite and upsampler is not None:
        raise UsageError("--crossing hermite needs dlog_dt, which sub-frames do not have; take cubic")
    if hermite and args.save_frames is not None:
        raise UsageError("--save-frames keeps no dlog_dt, which --crossing hermite needs; take cubic")
    with _part(args.source, options, chosen) as source, _finish_on_signal() as asked:
        if hermite and not source.has_slopes:
            raise ValueError(f"{args.source}: no dlog_dt, which --crossing hermite needs; take cubic")
        coding = Coding(
            source.tone, min(thresholds_of(known)), known["dark_level"], args.fps is None and args.slow_motion == 1
        )
        saved = None if args.save_frames is None else SavedFrames(args.save_frames)
        with open_writer(args.out, source.width, source.height, args.encoding) as writer:
            tally = _Tally(args.out, coding, upsampler, saved)
            with counted(source.count, "simulating") as step:
                frames = _frames(source, asked, step, args.rebase, coding)
                if upsampler is not None:
                    frames = _until(asked, upsampler.blocks(frames))
                if saved is not None:
                    frames = saved.passing(frames)
                failure = _pump(simulation, frames, writer, tally)
            if failure is not None and not simulation.frames:
                raise failure
    if failure is not None or asked.is_set():
        raise _stopped(failure, simulation, tally.taken(simulation), source, args.out)
    return tally.report(simulation, source)


def _part(path: str, options: FrameOptions, chosen: Selection) -> FrameSource:
    """Opens the frames, or the part of them that is wanted."""
    from evis.media.frames.open import open_frames
    from evis.media.frames.selection import SelectedFrames

    source = open_frames(path, options)
    if chosen.is_all:
        return source
    try:
        return SelectedFrames(source, chosen)
    except ValueError as error:
        source.close()
        raise ValueError(f"{path}: {error}") from None


def _frames(
    source: FrameSource, asked: threading.Event, step: Any, rebase: bool, coding: Coding
) -> Iterator[FrameBlock]:
    """The source's blocks, until somebody asks to stop."""
    shift: int | None = None
    for block in source.blocks():
        if asked.is_set():
            return
        shift = (int(block.t[0]) if rebase else 0) if shift is None else shift
        coding.add(block, source.about.get("bits"))
        yield block._replace(t=block.t - shift, ends=None)
        step(len(block.t))


def _until(asked: threading.Event, blocks: Iterator[FrameBlock]) -> Iterator[FrameBlock]:
    """What is made of a block of the source can take long: looks between its parts, too, whether to stop."""
    for block in blocks:
        yield block
        if asked.is_set():
            return


def _pump(simulation: Simulation, frames: Iterator[FrameBlock], writer: Any, tally: _Tally) -> Exception | None:
    """Write all events. Returns what went wrong with the frames or the sensor; errors of the writer are raised."""
    from evis.events import Events

    stream = simulation.events(frames)
    while True:
        try:
            made = next(stream, None)
        except Exception as error:
            return error
        if made is None:
            return None
        events = Events.of(made.t, made.x, made.y, made.p, made.c)
        tally.add(events)
        writer.write(events)


def _stopped(failure: Exception | None, simulation: Simulation, taken: int, source: FrameSource, out: str) -> Exception:
    """What to tell of a run that ended early: the file is complete up to some frame."""
    from evis.cli.failure import one_line

    total = f" of {source.count}" if source.count else ""
    held = f"{out} holds the events of {taken}{total} frames, up to t = {simulation.until_ns} ns"
    return ValueError(f"{one_line(failure) if failure is not None else 'stopped'}; {held}")


@contextmanager
def _finish_on_signal() -> Iterator[threading.Event]:
    """Ctrl-C and SIGTERM set an event, so that no write is cut in two; a second Ctrl-C ends at once."""
    asked = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield asked
        return

    def ask(number: int, frame: Any) -> None:
        if asked.is_set():
            raise KeyboardInterrupt
        asked.set()

    before = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class _Tally:
    """What was written, and what the file's format could not keep."""

    def __init__(self, out: str, coding: Coding, upsampler: Upsampler | None, saved: SavedFrames | None) -> None:
        self._coding, self._upsampler, self._saved = coding, upsampler, saved
        self._out, self._raw = out, holds_whole_us(out)
        self._events = self._rounded = self._colourless = 0

    def add(self, events: Any) -> None:
        """Counts a block."""
        self._events += len(events)
        self._rounded += rounded(events) if self._raw else 0
        self._colourless += colourless(events, self._out)

    def taken(self, simulation: Simulation) -> int:
        """Counts the frames of the source that the sensor has had."""
        return simulation.frames if self._upsampler is None else min(self._upsampler.gaps + 1, simulation.frames)

    def report(self, simulation: Simulation, source: FrameSource) -> dict[str, Any]:
        """Returns the action's result."""
        counts: dict[str, float] = {name: int(n) for name, n in simulation.counts().items() if n}
        result = {
            "out": self._out, "events": self._events, "width": source.width, "height": source.height,
            "frames": simulation.frames, "source": source.kind, **source.about,
        }  # fmt: skip
        if self._upsampler is not None:
            result |= {"source_frames": self.taken(simulation), "upsampling": self._upsampler.report()}
        if self._saved is not None:
            result |= {"saved_frames": self._saved.count}
        result |= self._coding.report()
        if "readout_delay_ns" in counts:
            total_ns, delayed = counts.pop("readout_delay_ns"), counts["readout_delayed"]
            counts["readout_delay_mean_us"] = round(total_ns / delayed / 1000, 3)
            counts["readout_delay_max_us"] = round(simulation.longest_delay_ns / 1000, 3)
        kept = {"times_rounded_to_us": self._rounded, "colour_left_out": self._colourless}
        result |= {name: n for name, n in kept.items() if n} | counts
        warnings = self._coding.warnings(self._upsampler is not None)
        if simulation.frames == 1:
            warnings.append("there is one frame, which is the reference; events need two or more")
        if (stretched := getattr(source, "stretched", 1.0)) != 1.0:
            warnings.append(
                f"the picture is {stretched:.2f} times as wide as it was; --crop a part of OUT's proportions"
            )
        if fields := source.about.get("interlaced_frames"):
            warnings.append(
                f"{fields} frames are interlaced: every other row was seen at another time, and edges that move fire "
                "in combs; make frames of the fields: ffmpeg -i IN -vf bwdif=send_field OUT"
            )
        if self._upsampler is not None:
            warnings += self._upsampler.warnings()
        if counts.get("nonfinite") and not simulation.parameters["dark_level"]:
            level = "" if source.tone is None else f" {source.tone.dark_level:g}"
            which = "black samples have" if level else "samples that are 0, negative or not finite have"
            warnings.append(f"{which} no logarithm and were skipped; try --dark-level{level}")
        return result | ({"warnings": warnings} if warnings else {})
