"""`evis events`: look into recordings, convert them, make events from frames, draw them."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from evis.streams import Events, Recording

HELP = "look into, convert, simulate and draw event recordings"
EXAMPLES = {
    "info": "evis events info recording.raw --json",
    "convert": "evis events convert recording.raw recording.npz",
    "simulate": "evis events simulate frames.npz events.raw --threshold 0.2",
    "render": "evis events render recording.raw picture.gif --dt 20 --to 1",
}
MAX_PICTURES = 3000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = "examples:\n" + "\n".join(f"  {e}" for e in EXAMPLES.values())
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")

    def action(name: str, text: str) -> argparse.ArgumentParser:
        return actions.add_parser(name, help=text, description=text, epilog=f"example: {EXAMPLES[name]}")

    info = action("info", "what a recording holds; times as stored, in ns")
    info.add_argument("recording", metavar="REC")
    info.add_argument("--json", action="store_true", help="print JSON")

    convert = action("convert", "write a recording in another format: .raw, .npz, .csv or .txt")
    convert.add_argument("source", metavar="IN")
    _add_output(convert)
    convert.add_argument("--rebase", action="store_true", help="let the times count from the first one")

    simulate = action("simulate", "events from an .npz of luminance (float32 [T,H,W], linear) and t (int64 ns)")
    simulate.add_argument("source", metavar="FRAMES.npz")
    _add_output(simulate)
    simulate.add_argument("--model", choices=["evis"], default="evis", help="event sensor model")
    simulate.add_argument("--threshold", type=float, default=0.2, metavar="C", help="contrast threshold (0.2)")
    simulate.add_argument("--threshold-on", type=float, metavar="C", help="ON threshold, when it is another one")
    simulate.add_argument("--threshold-off", type=float, metavar="C", help="OFF threshold, when it is another one")
    simulate.add_argument("--dark-level", type=float, default=0.0, metavar="I", help="luminance added before the log")
    simulate.add_argument("--defocus", type=float, default=0.0, metavar="PX", help="standard deviation of the blur")
    simulate.add_argument("--seed", type=int, default=0, metavar="N", help="of the noise; the ideal sensor has none")

    render = action("render", "draw a recording: an animation (.gif, .mp4) or a sheet of pictures (.png)")
    render.add_argument("recording", metavar="REC")
    render.add_argument("out", metavar="OUT")
    render.add_argument("--dt", type=float, default=20.0, metavar="MS", help="window of one picture (20)")
    render.add_argument("--from", type=float, default=0.0, dest="start", metavar="S", help="after the file's start")
    render.add_argument("--to", type=float, dest="stop", metavar="S", help="after the file's start")
    render.add_argument("--json", action="store_true", help="print JSON")


def _add_output(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("out", metavar="OUT")
    parser.add_argument("--encoding", default="", choices=["evt2", "evt3"], help="of a .raw file (evt3)")
    parser.add_argument("--json", action="store_true", help="print JSON")


def run(args: argparse.Namespace) -> int:
    """Do it. Raises ValueError or OSError with one line for a person."""
    action: Callable[[argparse.Namespace], dict[str, Any]] = {
        "info": _info, "convert": _convert, "simulate": _simulate, "render": _render
    }[args.action]
    result = action(args)
    if args.json:
        print(json.dumps(result))
    else:
        width = max(map(len, result))
        for name, value in result.items():
            shown = "; ".join(map(str, value)) if isinstance(value, list) else value
            print(f"{name:{width}}  {'-' if shown in ('', None) else shown}")
    return 0


@contextmanager
def _progress(recording: Recording, text: str) -> Iterator[Callable[[], None]]:
    """A progress bar over the file, on a terminal only."""
    if not sys.stderr.isatty():
        yield lambda: None
        return
    from tqdm import tqdm

    with tqdm(total=100, desc=text, unit="%", leave=False, file=sys.stderr) as bar:
        yield lambda: bar.update(int(100 * recording.position) - bar.n) and None


def _info(args: argparse.Namespace) -> dict[str, Any]:
    from evis.streams import open_recording

    n = on = triggers = 0
    first: int | None = None
    last: int | None = None
    with open_recording(args.recording) as recording, _progress(recording, "reading") as step:
        for events in recording.blocks():
            if len(events):
                first = int(events.t[0]) if first is None else first
                last = int(events.t[-1])
            n, on, triggers = n + len(events), on + int(events.p.sum(dtype=int)), triggers + len(events.triggers)
            step()
        about, dropped = recording.info, recording.counters()
    return {
        "format": about.format, "encoding": about.encoding, "width": about.width, "height": about.height,
        "events": n, "t_first_ns": first, "t_last_ns": last, "on": on, "off": n - on, "triggers": triggers,
        "geometry_from": about.geometry_from, "serial": about.serial, "sensor": about.sensor,
        "truncated": about.truncated, "warnings": about.warnings, **dropped,
    }


def _convert(args: argparse.Namespace) -> dict[str, Any]:
    from evis.streams import open_recording, open_writer

    n = rounded = triggers = 0
    with open_recording(args.source) as recording, _progress(recording, "converting") as step:
        about = recording.info
        if not about.width:
            raise ValueError(f"{args.source}: holds no events and no sensor size; there is nothing to convert")
        shift = (recording.next_t_ns or 0) if args.rebase else 0
        raw = args.out.lower().endswith(".raw")
        with open_writer(args.out, about.width, about.height, args.encoding) as writer:
            for events in recording.blocks():
                if shift:
                    events.t, events.triggers.t = events.t - shift, events.triggers.t - shift
                writer.write(events)
                n, triggers = n + len(events), triggers + len(events.triggers)
                rounded += _rounded(events) if raw else 0
                step()
        lost = recording.counters()
    result: dict[str, Any] = {"out": args.out, "events": n, **lost}
    if rounded:
        result["times_rounded_to_us"] = rounded
    if triggers:
        result["triggers" if raw else "triggers_left_out"] = triggers
    return result


def _rounded(events: Events) -> int:
    return int((events.t % 1000 != 0).sum())


def _simulate(args: argparse.Namespace) -> dict[str, Any]:
    from evis.streams import Events, open_writer
    from nodes.event_sensor.simulate import simulate_frames

    luminance, t = _frames(args.source)
    on = args.threshold if args.threshold_on is None else args.threshold_on
    off = args.threshold if args.threshold_off is None else args.threshold_off
    made = simulate_frames(
        luminance, t, threshold_on=on, threshold_off=off, dark_level=args.dark_level, defocus=args.defocus
    )
    events = Events.of(made["t"], made["x"], made["y"], made["p"])
    _, height, width = luminance.shape
    with open_writer(args.out, width, height, args.encoding) as writer:
        writer.write(events)
    result = {"out": args.out, "events": len(events), "width": width, "height": height, "frames": len(t)}
    if args.out.lower().endswith(".raw") and (rounded := _rounded(events)):
        result["times_rounded_to_us"] = rounded
    return result | {name: int(made[name]) for name in ("nonfinite", "clipped") if made.get(name)}


def _frames(path: str) -> tuple[Any, Any]:
    """luminance [T, H, W] and t [T] of an archive of frames. Raises ValueError."""
    import zipfile

    import numpy as np

    try:
        with np.load(path, allow_pickle=False) as archive:
            missing = [n for n in ("luminance", "t") if n not in archive]
            if missing:
                raise ValueError(f"{path}: no array {', '.join(missing)}; it has {', '.join(archive.files) or 'none'}")
            luminance, t = archive["luminance"], archive["t"]
    except FileNotFoundError:
        raise ValueError(f"{path}: no such file") from None
    except (zipfile.BadZipFile, EOFError, TypeError, AttributeError) as e:
        raise ValueError(f"{path}: not an .npz archive of frames, or a damaged one ({e})") from None
    if luminance.ndim != 3 or luminance.dtype.kind != "f" or 0 in luminance.shape:
        raise ValueError(f"{path}: luminance is {luminance.dtype} {list(luminance.shape)}, must be float32 [T, H, W]")
    if t.dtype.kind not in "iu" or t.shape != luminance.shape[:1]:
        raise ValueError(f"{path}: t is {t.dtype} {list(t.shape)}, must be int64 [{len(luminance)}], in ns")
    if len(t) > 1 and not (np.diff(t.astype(np.int64)) > 0).all():
        raise ValueError(f"{path}: t must go up from frame to frame")
    return luminance, t.astype(np.int64)


def _render(args: argparse.Namespace) -> dict[str, Any]:
    from evis.streams import open_recording
    from evis.streams.export import save_gif, save_mp4, save_sheet
    from evis.streams.picture import draw, windows

    savers = {".gif": save_gif, ".mp4": save_mp4, ".png": save_sheet}
    save = next((s for end, s in savers.items() if args.out.lower().endswith(end)), None)
    if save is None:
        raise ValueError(f"{args.out}: can draw {', '.join(savers)}")
    if not 0.001 <= args.dt <= 1e6:
        raise ValueError(f"--dt is {args.dt:g} ms, must be 0.001 to 1000000")
    if not 0 <= args.start <= 1e9 or (args.stop is not None and not args.start < args.stop <= 1e9):
        raise ValueError("--from and --to are seconds after the recording's start, --from below --to")
    stop = None if args.stop is None else round(args.stop * 1e9)
    count = 0
    with open_recording(args.recording) as recording, _progress(recording, "drawing") as step:
        about = recording.info

        def pictures() -> Iterator[tuple[int, Any]]:
            nonlocal count
            for start, events in windows(recording, round(args.dt * 1e6), round(args.start * 1e9), stop):
                if count == MAX_PICTURES:
                    raise ValueError(f"more than {MAX_PICTURES} pictures; choose a longer --dt or an earlier --to")
                count += 1
                step()
                yield start, draw(events, about.width, about.height)

        save(args.out, pictures(), args.dt)
    return {"out": args.out, "pictures": count, "width": about.width, "height": about.height}
