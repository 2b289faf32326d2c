"""What `interpolator:=auto` picks, beside the best of all fixed methods and rates at the same run time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from bench.metrics import Stream, victor_purpura
from bench.pipeline import THRESHOLD, simulate
from bench.probe import probe
from bench.probe_setting import Setting
from bench.world import World
from evis.clock import NS
from nodes.interpolator.choice import choose


@dataclass(frozen=True)
class Fixed:
    """A fixed choice that was measured: run time per simulated second, and error."""

    label: str
    seconds: float
    error: float


def compare(
    name: str,
    world: World,
    truth: Stream,
    duration_ns: int,
    fixed: Sequence[Fixed],
    light: dict[str, Any],
    known: Callable[[str, float, int], Fixed | None],
) -> list[dict[str, Any]]:
    """Rows of auto by its own rule and at the run times of three fixed choices, linear crossing times throughout.

    known: a fixed choice that was run already. Every choice is run in full; the ratio is its error over that of the
    best fixed choice that takes no more time than it does itself, and than was wanted.
    """
    scene = world.scene
    sensor = {"threshold": THRESHOLD, "crossing": "linear"}
    setting = Setting(scene, scene.camera("cam0"), duration_ns, sensor=sensor, light=light)
    began = setting.clock()
    candidates = probe(setting)
    spent = setting.clock() - began
    moving = _physics(setting, world)
    by_time = sorted(fixed, key=lambda f: f.seconds)
    budgets = [None, *(by_time[len(by_time) * part // 4].seconds for part in (1, 2, 3))]
    rows = []
    for budget in budgets:
        wanted = None if budget is None else 1 / (budget + moving)
        best = choose(candidates, wanted_rtf=wanted).candidate
        way = (best.method, best.keyframe_rate, best.upsampling)
        if best.method == "none":
            way = ("none", best.frame_rate, 1)
        own = known(*way) or _run(world, way, duration_ns, truth, light)
        rival = min((f for f in [*fixed, own] if f.seconds <= 1.02 * own.seconds), key=lambda f: f.error)
        in_budget = [f.error for f in fixed if f.seconds <= 1.02 * (budget or own.seconds)]
        rows.append({
            "scene": name,
            "wanted": "its own rule" if budget is None else f"{budget:.2f} s/s",
            "auto": own.label,
            "predicted [s/s]": round(best.seconds - moving, 2),
            "run time [s/s]": round(own.seconds, 2),
            "predicted VP 1/ms": round(best.error, 4),
            "VP 1/ms": round(own.error, 4),
            "best fixed": f"{rival.label} ({rival.error:.4f}, {rival.seconds:.2f} s/s)",
            "ratio": round(own.error / max(rival.error, 1e-9), 2),
            "ratio, wanted time": round(own.error / max(min(in_budget, default=own.error), 1e-9), 2),
            "measuring took [s]": round(spent, 1),
        })  # fmt: skip
    return rows


def _physics(setting: Setting, world: World) -> float:
    """Seconds per simulated second that the engine takes, which the runs here do not contain."""
    if not world.scene.dynamic:
        return 0.0
    began = setting.clock()
    World(world.scene, setting.duration_ns)
    return (setting.clock() - began) / (setting.duration_ns / NS)


def _run(world: World, way: tuple[str, float, int], duration_ns: int, truth: Stream, light: dict[str, Any]) -> Fixed:
    method, rate, k = way
    run = simulate(world, method, rate, k, duration_ns, ("linear",), None, light)
    error = victor_purpura(run.streams["linear"], truth, 1.0)
    return Fixed(label_of(method, rate, k), run.seconds("linear") / duration_ns * NS, error)


def label_of(method: str, rate: float, k: int) -> str:
    """Method, keyframes per second x K."""
    return f"{'dense' if method == 'none' else method} {rate:g}x{k}"
