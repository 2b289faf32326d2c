"""Samples of single pixels between frames (`time_tolerance`): error and CPU time beside frames alone.

python -m bench.interpolation.between [--quick]
"""

from __future__ import annotations

from typing import Any

from bench import command
from bench.interpolation.pipeline import Run, reference, simulate
from evis.events.measure.distance import EventStream, victor_purpura
from evis.runtime.clock import NS
from evis.scene import load_scene
from nodes.interpolator.auto.world import World

SCENES = (
    "spinning_disk", "drone", "fidget_spinner", "tunnel_exit", "falling_objects", "warehouse", "robot_arm", "pan_tilt",
)  # fmt: skip
SIZE = {"width": 96, "height": 72}
RATE = 31.25
"""Keyframes per second: gaps of 32 ms."""
TIME_TOLERANCE_S = 1e-4
GAPS = 3
TRUTH_HZ = 16_000.0
CASES: dict[str, tuple[str, float, int, float]] = {
    "31x8 frames": ("rigid", RATE, 8, 0.0),
    "31x32 frames": ("rigid", RATE, 32, 0.0),
    "31x4, further samples": ("rigid", RATE, 4, TIME_TOLERANCE_S),
    "31x8, further samples": ("rigid", RATE, 8, TIME_TOLERANCE_S),
    "31x16, further samples": ("rigid", RATE, 16, TIME_TOLERANCE_S),
    "dense 1000 Hz": ("none", 32 * RATE, 1, 0.0),
}
"""Method, keyframes per second, K and time_tolerance [s]."""


def row(scene: str, name: str, world: World, truth: EventStream, duration_ns: int) -> dict[str, Any]:
    """Measures one case: spike-train error at 1/ms, events, and CPU time per gap of 32 ms."""
    method, rate, upsampling, tolerance = CASES[name]
    warp = {"time_tolerance": tolerance} if method == "rigid" else {}
    run: Run = simulate(world, method, rate, upsampling, duration_ns, warp=warp)
    events = run.streams["linear"]
    return {
        "scene": scene,
        "samples": name,
        "error": round(victor_purpura(events, truth, 1.0), 3),
        "events [%]": round(100 * (len(events.t) / max(len(truth.t), 1) - 1), 1),
        "render [ms]": round(1e3 * run.render_s / GAPS, 1),
        "interpolate [ms]": round(1e3 * run.interpolate_s / GAPS, 1),
        "sense [ms]": round(1e3 * run.sense_s["linear"] / GAPS, 1),
    }


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures all cases on eight scenes; quick: on two, against 4 kHz."""
    duration, truth_hz = round(GAPS * NS / RATE), TRUTH_HZ / 4 if quick else TRUTH_HZ
    rows = []
    for scene in SCENES[:1] + SCENES[6:7] if quick else SCENES:
        world = World(load_scene(scene, SIZE), duration)
        truth = reference(world, truth_hz, duration, NS)[0]
        rows += [row(scene, name, world, truth, duration) for name in CASES]
    return {
        "between": {
            "title": "Samples of single pixels between frames, {width}x{height}".format(**SIZE),
            "command": "python -m bench.interpolation.between",
            "rows": rows,
            "note": f"Error: Victor-Purpura at 1/ms against dense rendering at {truth_hz:g} Hz. CPU time per gap of "
            f"{1e3 / RATE:g} ms, one core; time_tolerance {1e3 * TIME_TOLERANCE_S:g} ms with further samples.",
        }
    }


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
