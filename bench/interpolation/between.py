"""Measures error against CPU time with samples of single pixels between frames (`time_tolerance`), and without.

evis bench between [--quick]
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench import command
from bench.interpolation.pipeline import Run, reference, simulate
from evis.events.measure.distance import EventStream, victor_purpura
from evis.runtime.clock import NS
from evis.scene import load_scene
from nodes.interpolator.auto.choice import frames_beside_samples
from nodes.interpolator.auto.world import World

SCENES = (
    "spinning_disk", "drone", "fidget_spinner", "tunnel_exit", "falling_objects", "warehouse", "robot_arm", "pan_tilt",
)  # fmt: skip
SIZE = {"width": 96, "height": 72}
RATE = 31.25
"""Keyframes per second: gaps of 32 ms."""
TIME_TOLERANCES_S = (8e-4, 3e-4, 1e-4)
GAPS = 3
RUNS = 3
"""Of which the quickest counts; of dense rendering, which takes longer, there is one."""
TRUTH_HZ = 16_000.0


@dataclass(frozen=True)
class Way:
    """Describes how a scene is sampled: method, keyframes per second, K and time_tolerance [s]."""

    family: str
    method: str
    rate: float
    upsampling: int
    tolerance: float = 0.0

    @property
    def label(self) -> str:
        """Gives its name in a table."""
        frames = f"{self.rate:.0f}x{self.upsampling}" if self.method == "rigid" else f"{self.rate:.0f} Hz"
        within = f" {1e3 * self.tolerance:g} ms" if self.tolerance else ""
        return f"{frames} {self.family}{within}"


FRAMES, FURTHER, DENSE = "frames", "further samples", "dense"
WAYS = (
    *(Way(FRAMES, "rigid", RATE, k) for k in (8, 16, 32, 64)),
    *(Way(FURTHER, "rigid", RATE, frames_beside_samples(RATE, t), t) for t in TIME_TOLERANCES_S),
    *(Way(DENSE, "none", rate * RATE, 1) for rate in (8, 32, 64, 128)),
)
STYLES = {FRAMES: ("^-", "tab:red"), FURTHER: ("*-", "tab:green"), DENSE: ("o-", "tab:blue")}
"""Marker, line and colour by family."""
TITLES = {FRAMES: "frames alone", FURTHER: "with further samples, by time_tolerance", DENSE: "dense rendering"}


def seconds(run: Run) -> float:
    """Adds up the CPU time of a run."""
    return run.render_s + run.interpolate_s + run.sense_s["linear"]


def row(scene: str, way: Way, world: World, truth: EventStream, duration_ns: int, runs: int) -> dict[str, Any]:
    """Measures one way: spike-train error at 1/ms, events, and CPU time per gap of 32 ms."""
    warp = {"time_tolerance": way.tolerance} if way.method == "rigid" else {}
    count = runs if way.method == "rigid" else 1
    made = [
        simulate(world, way.method, way.rate, way.upsampling, duration_ns, warp=warp, rehearsed=True)
        for _ in range(count)
    ]
    run: Run = min(made, key=seconds)
    events = run.streams["linear"]
    parts = {"render": run.render_s, "interpolate": run.interpolate_s, "sense": run.sense_s["linear"]}
    line: dict[str, Any] = {
        "scene": scene,
        "samples": way.label,
        "error": round(victor_purpura(events, truth, 1.0), 3),
        "events [%]": round(100 * (len(events.t) / max(len(truth.t), 1) - 1), 1),
    }
    line |= {f"{name} [ms]": round(1e3 * part / GAPS, 1) for name, part in parts.items()}
    return line | {"all [ms]": round(1e3 * seconds(run) / GAPS, 1)}


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures all ways on eight scenes; quick: on two, against 4 kHz."""
    duration, truth_hz = round(GAPS * NS / RATE), TRUTH_HZ / 4 if quick else TRUTH_HZ
    rows = []
    for scene in SCENES[:1] + SCENES[6:7] if quick else SCENES:
        world = World(load_scene(scene, SIZE), duration)
        truth = reference(world, truth_hz, duration, NS)[0]
        rows += [row(scene, way, world, truth, duration, 1 if quick else RUNS) for way in WAYS]
    return {
        "between": {
            "title": "Samples of single pixels between frames, {width}x{height}".format(**SIZE),
            "command": "evis bench between",
            "rows": rows,
            "note": f"Error: Victor-Purpura at 1/ms against dense rendering at {truth_hz:g} Hz. CPU time per gap of "
            f"{1e3 / RATE:g} ms, one core, least of {RUNS} runs (dense: one). With further samples: time_tolerance, "
            "and K as upsampling:=auto has it.",
        }
    }


def plot(sections: dict[str, Any], out: Path) -> list[Path]:
    """Writes between.png: error against CPU time."""
    return [draw(sections["between"]["rows"], "all [ms]", "CPU time [ms per 32 ms]", out / "between.png")]


def draw(rows: Sequence[dict[str, Any]], cost: str, label: str, path: Path) -> Path:
    """Plots error against cost, a panel for each scene, both axes logarithmic. cost: its column; label: of its axis."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    rows = [line for line in rows if line.get(cost) and line["error"]]
    scenes = list(dict.fromkeys(line["scene"] for line in rows))
    columns = max(1, min(4, len(scenes)))
    lines = max(1, -(-len(scenes) // columns))
    figure, panels = plt.subplots(lines, columns, figsize=(3.6 * columns, 3.4 * lines), squeeze=False)
    for axes, scene in zip(panels.flat, scenes):
        _panel(axes, [line for line in rows if line["scene"] == scene], cost)
        axes.set_title(scene, fontsize=10)
    for axes in panels[-1]:
        axes.set_xlabel(label, fontsize=9)
    for axes in panels[:, 0]:
        axes.set_ylabel("spike-train error (1/ms)", fontsize=9)
    for axes in panels.flat[len(scenes) :]:
        axes.set_axis_off()
    handles, labels = panels.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower center", ncols=3, fontsize=9, frameon=False)
    figure.tight_layout(rect=(0, 0.05, 1, 1))
    figure.savefig(path, dpi=110)
    plt.close(figure)
    return path


def _panel(axes: Any, rows: Sequence[dict[str, Any]], cost: str) -> None:
    """One scene."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    for family, (style, colour) in STYLES.items():
        own = [line for line in rows if family in line["samples"]]
        each = ", ".join(" ".join(line["samples"].replace(family, "").split()) for line in own)
        points = [(line[cost], line["error"]) for line in own]
        size = 8 if family == FURTHER else 5
        axes.plot(*zip(*points), style, color=colour, ms=size, lw=1.1, label=f"{TITLES[family]}: {each}")
    axes.set(xscale="log", yscale="log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
    axes.grid(True, which="major", alpha=0.3)


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
