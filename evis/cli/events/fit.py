"""Implements `evis events fit`, which fits a sensor's parameters to recordings of a real one."""

from __future__ import annotations

import argparse
import os
from typing import TYPE_CHECKING, Any

from evis.cli.numbers import number_up_to
from evis.cli.parser import UsageError

if TYPE_CHECKING:
    from nodes.event_sensor.fit.clip import Clip

HELP = "fit thresholds, bandwidth, dead time and noise to recordings of a real sensor; writes a preset"
_ABOVE_0 = number_up_to(1e9, "must be a number above 0")
SCENES = {"wheel": "a wheel, half black and half white, that turns before a camera at rest"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the action's arguments."""
    parser.add_argument("recordings", nargs="+", metavar="RECORDING", help="fitted together, in any format")
    known = "; ".join(f"{name}: {what}" for name, what in SCENES.items())
    parser.add_argument(
        "--scene", choices=list(SCENES), default="wheel", metavar="NAME", help=f"what they show ({known}); where it "
        "stands and how it moves is found in each recording"
    )  # fmt: skip
    parser.add_argument(
        "--check", nargs="+", default=[], metavar="RECORDING", help="others, which the fitted sensor must foretell"
    )
    parser.add_argument("--out", metavar="FILE", help="a preset to write, as mine.yaml: preset:=mine.yaml takes it")
    parser.add_argument("--png", metavar="FILE", help="draw the fit beside the recordings into a file")
    parser.add_argument(
        "--contrast", type=_ABOVE_0, metavar="X", help="ln(white / black) of the scene, which events cannot tell from "
        "the thresholds (2.1)"
    )  # fmt: skip
    parser.add_argument("--contrast-error", type=_ABOVE_0, metavar="X", help="how well that is known (0.4)")
    parser.add_argument("--lux", type=_ABOVE_0, metavar="E", help="light on the scene, for levels in radiance (500)")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Fits a sensor, compares it with the recordings, and writes its parameters."""
    _check_outputs(args)
    from evis.cli.events.progress import PassProgress
    from evis.warp_start import start_warp
    from nodes.event_sensor.fit.fit import CONTRAST, CONTRAST_DEVIATION, CONTRAST_SOURCE, LUX, fit_sensor, light_of
    from nodes.event_sensor.fit.report import assumption, report, sources

    start_warp()
    contrast, deviation = args.contrast or CONTRAST, args.contrast_error or CONTRAST_DEVIATION
    source = CONTRAST_SOURCE if args.contrast is None else "given by --contrast"
    lux = args.lux or LUX
    light = light_of(contrast, lux)
    with PassProgress("fitting") as progress:
        clips, others = ([_clip(path) for path in paths] for paths in (args.recordings, args.check))
        fit = fit_sensor(clips, others, light, progress.say)
    result = report(fit, light, deviation, source, lux)
    if args.out:
        from nodes.event_sensor.fit.preset_file import write_preset

        head = ["Fitted by `evis events fit`. Recorded beside simulated:", *_lines(result)]
        head.append(assumption(light, deviation, source, lux))
        write_preset(args.out, head, fit.values, sources(fit, deviation / contrast))
        result["out"] = args.out
    if args.png:
        from nodes.event_sensor.fit.plot import draw

        draw(fit, light, args.png)
        result["png"] = args.png
    return result


def _check_outputs(args: argparse.Namespace) -> None:
    if args.out and not args.out.endswith((".yaml", ".yml")):
        raise UsageError(f"--out {args.out}: a preset is a .yaml file")
    if args.out and not os.path.isdir(os.path.dirname(os.path.abspath(args.out))):
        raise UsageError(f"--out {args.out}: its folder does not exist; make it first")
    if args.contrast_error and not args.contrast:
        raise UsageError("--contrast-error goes with --contrast")
    if args.png:
        from evis.cli.events.measure_plot import check

        check(args.png)


def _clip(path: str) -> Clip:
    """Reads a recording and finds the scene in it. Raises ValueError naming the file."""
    from evis.events import open_recording
    from nodes.event_sensor.fit.clip import read_clip
    from nodes.event_sensor.fit.wheel import NoWheel

    with open_recording(path) as recording:
        events = recording.read()
    try:
        return read_clip(os.path.basename(path), events.t, events.x, events.y, events.p)
    except NoWheel as error:
        raise ValueError(f"{path}: {error}") from None


def _lines(result: dict[str, Any]) -> list[str]:
    """How the fitted sensor does, a line for each recording."""
    lines = []
    for one in result["recordings"]:
        off = ", ".join(f"{name} {value:+.0%}" for name, value in one["off_by"].items())
        noise = f"noise {one['simulated']['noise_hz']:.3g} Hz, recorded {one['recorded']['noise_hz']:.3g}"
        lines.append(f"{one['name']}{'' if one['fitted'] else ' (not fitted)'}: {off}; {noise}")
    return lines


def for_people(result: dict[str, Any]) -> dict[str, Any]:
    """Writes values with their uncertainties, and a line for each recording."""
    spread, assumed = result["deviation"], result["assumed"]
    out: dict[str, Any] = {
        name: f"{value:.4g}" + (f" +- {spread[name]:.2g}" if name in spread else "")
        for name, value in result["values"].items()
    }
    out["assumed contrast"] = (
        f"{assumed['contrast']:g} +- {assumed['contrast_deviation']:g}: {assumed['contrast_source']}"
    )
    out["assumed light"] = f"white paper in {assumed['white_lux']:g} lux"
    laws = ", ".join(f"{name} {value:.3g}" for name, value in result["laws"].items())
    out["misfit by law of the corner"] = laws
    for one, line in zip(result["recordings"], _lines(result)):
        out[one["name"]] = line.partition(": ")[2] + ("" if one["fitted"] else " (not fitted)")
        scene = one["scene"]
        out[f"scene of {one['name']}"] = (
            f"hub {scene['hub_px']}, {scene['turns']:.2f} turns, {scene['speed_rad_s'][0]:.3g} to "
            f"{scene['speed_rad_s'][1]:.3g} rad/s, blur {scene['blur_px']:.2f} px"
        )
    return out | {name: result[name] for name in ("out", "png", "warnings") if name in result}
