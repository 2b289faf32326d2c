"""Runs the benchmarks and writes report.json and index.html."""

from __future__ import annotations

import datetime
import html
import importlib
import importlib.util
import json
import os
import platform
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from bench.sections import as_html

SUBJECTS = {
    "interpolation": (
        "bench.interpolation.methods",
        "error against run time, every method and keyframe rate, against dense rendering",
    ),
    "bus": ("bench.graph.bus", "cost of a message between processes, against plain ZeroMQ"),
    "graph": ("bench.graph.runs", "real-time factor, where the time goes, overhead, what omissions save"),
    "gpu_graph": ("bench.gpu_graph", "whole runs on one device: speed, how busy it is, memory, first event"),
    "simulation": ("bench.graph.simulation", "evis.Simulation: a step above its nodes, start-up, reset"),
    "event_sensor": (
        "bench.event_sensor.sensor",
        "time error against closed forms, speed against the models of other simulators, cost of each fault",
    ),
    "physics": (
        "bench.physics.work_precision",
        "error of the dynamics against run time, by integrator and time step, against closed forms",
    ),
    "renderer": ("bench.renderer.stages", "milliseconds per keyframe and stage, raster against rays"),
    "renderer_paths": ("bench.renderer.paths", "milliseconds of path tracing, and how still its noise is"),
    "renderer_peers": (
        "bench.renderer.peers",
        "the renderer beside MuJoCo's, MuJoCo Warp's and Mitsuba 3, those that are installed",
    ),
    "visibility": (
        "bench.visibility.subframes",
        "what sub-frames see: the raster beside points moved from keyframes, time and error",
    ),
    "light": (
        "bench.interpolation.light",
        "error and run time where light changes between keyframes, against dense rendering",
    ),
    "audit": (
        "bench.interpolation.audit",
        "what an audit costs beside its run, and how wide its interval is",
    ),
    "between": (
        "bench.interpolation.between",
        "samples of single pixels between frames: error against CPU time, beside frames alone and dense rendering",
    ),
    "interpolation_speed": (
        "bench.interpolation.speed",
        "nanoseconds per pixel and sub-frame of interpolator and sensor",
    ),
    "streams": ("bench.streams.codecs", "decoding speed, against other libraries"),
    "representations": ("bench.streams.representations", "voxel grids and their like, against numpy and tonic"),
    "environments": ("bench.graph.environments", "steps per second of environments, beside Gymnasium's frames"),
    "dataset": ("bench.dataset.making", "sequences per hour, beside a shell loop of evis launch"),
    "layouts": ("bench.dataset.layouts", "bytes per event of each layout of data sets, writing and reading"),
    "loading": ("bench.dataset.loading", "windows of data sets: read beside h5py's bare read, simulated beside read"),
    "bag": ("bench.graph.bag", "recording speed"),
    "camera": ("bench.graph.camera", "camera node on emulated USB: sustained rate, losses, CPU share, latency"),
}
"""Name -> module with `measure(quick)` and perhaps `plot(sections, folder)`, and what it measures."""

BY_THEMSELVES = {
    "bench.interpolation.extremes": "motion too fast for frames, with samples of single pixels between them",
    "bench.interpolation.random_scenes": "samples between frames on scenes drawn at random",
    "bench.event_sensor.further": "cost of further samples of single pixels between frames",
    "bench.graph.recording": "events per second that a bag takes, by threads and by the size of the messages",
    "bench.graph.frame_camera": "what images of a frame sensor cost beside the events",
    "bench.event_sensor.gpu": "the sensor on a CUDA device, against its memory's bandwidth",
    "bench.interpolation.gpu": "gaps on a CUDA device, and where their time goes",
    "bench.renderer.gpu": "the renderer on a CUDA device, stage by stage and kernel by kernel",
    "bench.renderer.light": "shading by kind of light, material and sky; noise of soft shadows",
    "bench.measure.disks": "`evis events measure` on disks of known speed",
    "bench.event_sensor.video": "events of video with and without sub-frames along optical flow, against dense frames",
    "bench.measure.clips": "`evis events measure` on clips of a real wheel (EVIS_TEST_DATA=DIR)",
    "bench.measure.long": "`evis events measure` on long streams: memory and CPU time",
    "bench.physics.engines": "MuJoCo Warp beside MuJoCo on stiff and extreme cases",
    "bench.physics.environments": "many environments of MuJoCo's models, by threads and by MuJoCo Warp",
    "bench.event_hashes": "hashes of every scene's events, and whether a change has changed any",
    "bench.documents": "writes the tables of docs/performance.md and docs/dynamics.md from reports",
    "bench.streams.peers": "other libraries that read event streams, in the Python that has them",
}
"""Module that `evis bench` does not run -> what it does; `python -m MODULE`."""

EXTRA = ("gymnasium", "pygame", "matplotlib")
"""Packages of the extra `bench`."""
NO_PLOTS = "no plots, for matplotlib is not installed: pip install 'evis[bench]'"

HEAD = """<!doctype html><meta charset=utf-8><title>EVIS report</title><style>
body { font: 15px/1.45 system-ui; margin: 2em auto; max-width: 70em; padding: 0 1em }
table { border-collapse: collapse; margin: .6em 0 }
td, th { padding: .25em .7em; border-bottom: 1px solid #ddd; text-align: right }
td:first-child, th:first-child { text-align: left }
th { vertical-align: bottom }
tr:hover { background: #f6f8fa }
img { max-width: 100% }
code { background: #f2f2f2 }
.note { color: #555 }
</style><h1>EVIS: error, speed and cost</h1>"""


def machine() -> dict[str, Any]:
    """Describes this machine: processor, number of cores, Python's version, system."""
    cpu = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = (line.split(":", 1)[1].strip() for line in info.read_text().splitlines() if "model name" in line)
        cpu = next(names, cpu)
    return {"cpu": cpu, "cores": os.cpu_count(), "python": platform.python_version(), "system": platform.system()}


def report_of(subjects: dict[str, Any], quick: bool) -> dict[str, Any]:
    """Makes a report of these subjects' sections, measured here and today."""
    today = datetime.date.today().isoformat()
    report: dict[str, Any] = {"machine": machine(), "date": today, "quick": quick, "subjects": subjects}
    return report | {"plots": [], "notes": [], "failures": []}


def run(subjects: Sequence[str], out: Path, quick: bool, say: Callable[[str], None]) -> dict[str, Any]:
    """Measures the subjects one after another and writes the report after each, so that a failure loses nothing."""
    out.mkdir(parents=True, exist_ok=True)
    report = report_of({}, quick)
    drawn = importlib.util.find_spec("matplotlib") is not None
    for subject in subjects:
        path, what = SUBJECTS[subject]
        say(f"{subject}: {what}")
        started = time.monotonic()
        try:
            module = importlib.import_module(path)
            if hasattr(module, "plot") and not drawn:
                say(f"{subject}: {NO_PLOTS}")
                report["notes"].append(f"{subject}: {NO_PLOTS}")
            report["subjects"][subject] = sections = module.measure(quick)
            if hasattr(module, "plot") and drawn:
                report["plots"] += [path.name for path in module.plot(sections, out)]
        except Exception as error:  # one subject that fails must not hide the others; it is listed
            what = f"{type(error).__name__}: {error}"
            if isinstance(error, ModuleNotFoundError) and error.name in EXTRA:
                what = f"{error.name} is not installed: pip install 'evis[bench]'"
            report["failures"].append({"subject": subject, "error": what})
            (out / f"{subject}.traceback.txt").write_text(traceback.format_exc())
        say(f"{subject}: {time.monotonic() - started:.0f} s")
        (out / "report.json").write_text(json.dumps(report, indent=1, default=str))
        (out / "index.html").write_text(page(report))
    return report


def page(report: dict[str, Any]) -> str:
    """Makes one HTML page of a report."""
    about = ", ".join(f"{k} {v}" for k, v in report["machine"].items())
    parts = [HEAD, f"<p>{html.escape(about)}, {report['date']}</p>"]
    parts += [f'<p><img src="{html.escape(name)}" alt="{html.escape(name)}">' for name in report["plots"]]
    for subject, sections in report["subjects"].items():
        parts.append(f"<h2>{html.escape(subject)}</h2>")
        for section in sections.values():
            if isinstance(section, dict) and "rows" in section:
                parts.append(as_html(section))
    parts.append("<h2>Omissions and failures</h2><ul>")
    parts += [f"<li>{html.escape(f['subject'])}: {html.escape(f['error'])}</li>" for f in report["failures"]]
    parts += [f"<li>{html.escape(o)}</li>" for o in (*report["notes"], *OMISSIONS)]
    return "\n".join([*parts, "</ul>"])


OMISSIONS = (
    "Between keyframes the rigid interpolator shades anew where a bound on the change of light asks for it, no finer "
    "than the frames unless time_tolerance has single pixels evaluated between them. The splat interpolators know no "
    "more of the motion than the keyframes' own vectors tell.",
    "The USB drivers have been run against emulated devices and on recorded streams, not on cameras.",
    "Light is direct unless bounces or sky_occlusion ask for paths: no reflections between surfaces, no shadow from "
    "the sky, no emissive surface as a light.",
    "A light that flickers faster than the keyframes is followed by rigid and by dense rendering, not by splat.",
    "Simulators that need PyTorch, ROS or Isaac Sim are quoted, not run; the ESIM core runs beside ours where "
    "EVIS_PEERS names a checkout of it.",
)
"""What the published figures do not cover."""
