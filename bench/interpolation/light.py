"""Measures error and run time of `rigid` where light changes between keyframes, beside as many frames of dense
rendering.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bench import command
from bench.interpolation.pipeline import Run, reference, simulate
from evis.events.measure.distance import EventStream, victor_purpura
from evis.runtime.clock import NS
from evis.scene import load_scene
from nodes.interpolator.auto.world import World

COMMAND = "evis bench light"
CASES = Path(__file__).parent / "light_scenes"
SCENES = ("spinning_disk", "fidget_spinner", "falling_objects", "robot_arm", "drone", "warehouse", "tunnel_exit")
"""Those that come with EVIS and have a camera `cam0`; `stereo_room` shows the room of `drone`."""
RATE, UPSAMPLING = 30.0, 32
DENSE_HZ = RATE * UPSAMPLING
TOLERANCES = (0.1, 0.05)
SIZES = {True: {"width": 96, "height": 72}, False: {"width": 173, "height": 130}}
"""Of the small scenes, and of those that come with EVIS."""


def _error(run: Run, truth: EventStream) -> float:
    return victor_purpura(run.streams["linear"], truth, 1.0)


def row(name: str, scene: str, size: dict[str, int], duration_ns: int, truth_hz: float) -> dict[str, Any]:
    """Measures one scene: spike-train error at 1/ms and CPU time of dense rendering and of `rigid`."""
    world = World(load_scene(scene, size), duration_ns)
    truth, _, _ = reference(world, truth_hz, duration_ns, NS)
    dense = simulate(world, "none", DENSE_HZ, 1, duration_ns)
    made = {t: simulate(world, "rigid", RATE, UPSAMPLING, duration_ns, warp={"tolerance": t}) for t in TOLERANCES}
    first = made[TOLERANCES[0]]
    took = dense.seconds("linear") * NS / duration_ns
    line: dict[str, Any] = {
        "scene": name,
        "events": len(truth.t),
        "dense": round(_error(dense, truth), 3),
        **{f"rigid, tolerance {t:g}": round(_error(run, truth), 3) for t, run in made.items()},
        "excess": round(_error(first, truth) - _error(dense, truth), 3),
        "events of rigid [%]": round(100 * (len(first.streams["linear"].t) / max(len(truth.t), 1) - 1), 1),
        "dense [s/s]": round(took, 2),
        "rigid [s/s]": round(first.seconds("linear") * NS / duration_ns, 2),
        "rigid / dense": round(first.seconds("linear") / dense.seconds("linear"), 2),
        "shaded anew [%]": round(100 * first.reshaded / max(first.samples, 1), 1),
    }
    return line


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures the small scenes of light_scenes and those that come with EVIS; quick: three and two of them."""
    cases = sorted(CASES.glob("*.yaml"))[:3] if quick else sorted(CASES.glob("*.yaml"))
    scenes: Sequence[str] = ("spinning_disk", "robot_arm") if quick else SCENES
    duration, truth_hz = (NS // 15, 4 * DENSE_HZ) if quick else (NS // 5, 8 * DENSE_HZ)
    note = (
        f"rigid: {RATE:g} keyframes per second x {UPSAMPLING}; dense: {DENSE_HZ:g} rendered frames per second. Errors "
        "are spike-train distances (Victor-Purpura, 1/ms) to dense rendering at {:g} Hz; excess: above dense. "
        "CPU times of renderer, interpolator and sensor, one core."
    )
    return {
        "light": {
            "title": "Light that changes between keyframes, {width}x{height}".format(**SIZES[True]),
            "command": COMMAND,
            "rows": [row(path.stem, str(path), SIZES[True], duration, truth_hz) for path in cases],
            "note": note.format(truth_hz),
        },
        "scenes": {
            "title": "Scenes that come with EVIS, {width}x{height}".format(**SIZES[False]),
            "command": COMMAND,
            "rows": [row(name, name, SIZES[False], duration, truth_hz / 2) for name in scenes],
            "note": note.format(truth_hz / 2),
        },
    }


def plot(sections: dict[str, Any], out: Path) -> list[Path]:
    """Writes light.png: error against run time of dense rendering and of `rigid`, a line for each scene."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(1, 2, figsize=(13, 6), dpi=110)
    for axes, section in zip(panels, sections.values(), strict=True):
        for line in section["rows"]:
            took, error = (line["dense [s/s]"], line["rigid [s/s]"]), (line["dense"], line["rigid, tolerance 0.1"])
            (drawn,) = axes.plot(took, error, lw=1)
            axes.plot(took[:1], error[:1], "o", color=drawn.get_color())
            axes.plot(took[1:], error[1:], "^", color=drawn.get_color())
            axes.annotate(line["scene"], (took[1], error[1]), xytext=(4, 4), textcoords="offset points", fontsize=8)
        axes.set_xscale("log")
        axes.set_ylim(0, None)
        axes.set_title(section["title"], fontsize=11)
        axes.set_xlabel("run time [s per simulated s], one core")
    panels[0].set_ylabel("spike-train error (Victor-Purpura, 1/ms)")
    figure.suptitle("From dense rendering (circles) to rigid (triangles) at as many frames")
    figure.tight_layout()
    path = out / "light.png"
    figure.savefig(path)
    plt.close(figure)
    return [path]


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
