"""Compares what `interpolator:=auto` picks with the best of all fixed methods and rates at the same run time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from bench.interpolation.pipeline import THRESHOLD, simulate
from evis.events.measure.distance import EventStream, victor_purpura
from evis.runtime.clock import NS
from nodes.interpolator.auto.choice import EVEN
from nodes.interpolator.auto.probe import probe
from nodes.interpolator.auto.setting import Setting
from nodes.interpolator.auto.trial import settle
from nodes.interpolator.auto.world import World


@dataclass(frozen=True)
class Fixed:
    """Holds a fixed choice that was measured: run time per simulated second, and error."""

    label: str
    seconds: float
    error: float


@dataclass(frozen=True)
class Wish:
    """Describes what auto is asked for: to follow its own `rule`, or a `time` [s/s] or `error` (VP) that is wanted."""

    kind: str
    wanted: float = 0.0

    @property
    def label(self) -> str:
        """Gives the cell of a table."""
        told = {"rule": "its own rule", "time": f"{self.wanted:.2f} s/s", "error": f"VP {self.wanted:.3f}"}
        return told[self.kind]


def wishes_of(fixed: Sequence[Fixed]) -> list[Wish]:
    """Lists what auto is asked for: its rule, run times of three of the fixed choices, and errors of two."""
    by_time, by_error = sorted(f.seconds for f in fixed), sorted(f.error for f in fixed)
    times = [Wish("time", by_time[len(fixed) * part // 4]) for part in (1, 2, 3)]
    return [Wish("rule"), *times, *(Wish("error", by_error[len(fixed) * part // 4]) for part in (1, 2))]


def compare(
    name: str,
    world: World,
    truth: EventStream,
    duration_ns: int,
    fixed: Sequence[Fixed],
    light: dict[str, Any],
    known: Callable[[str, float, int], Fixed | None],
) -> list[dict[str, Any]]:
    """Compares auto with fixed choices: by its own rule, at three run times and at two errors, linear crossing times.

    known: a fixed choice that was run already. Every choice is run in full. The ratios are those of `ratios`.
    """
    scene = world.scene
    sensor = {"threshold": THRESHOLD, "crossing": "linear"}
    setting = Setting(scene, scene.camera("cam0"), duration_ns, sensor=sensor, light=light)
    began = setting.clock()
    measured = probe(setting)
    spent = setting.clock() - began
    rows = []
    for wish in wishes_of(fixed):
        began, tried = setting.clock(), len(measured.trials)
        error = wish.wanted if wish.kind == "error" else None
        rtf = 1 / (wish.wanted + measured.moving) if wish.kind == "time" and wish.wanted else None
        best = settle(setting, measured, error, rtf).candidate
        trials = setting.clock() - began
        way = (best.method, best.keyframe_rate, best.upsampling)
        if best.method == "none":
            way = ("none", best.frame_rate, 1)
        own = known(*way) or _run(world, way, duration_ns, truth, light)
        line: dict[str, Any] = {
            "scene": name,
            "wanted": wish.label,
            "auto": own.label,
            "predicted [s/s]": round(best.seconds - measured.moving, 2),
            "run time [s/s]": round(own.seconds, 2),
            "predicted VP 1/ms": round(best.error, 4),
            "VP 1/ms": round(own.error, 4),
        }
        line |= ratios(wish, own, fixed)
        line["measuring took [s]"] = f"{spent:.1f} + {trials:.1f} ({len(measured.trials) - tried} trials)"
        rows.append(line)
    return rows


def ratios(wish: Wish, own: Fixed, fixed: Sequence[Fixed]) -> dict[str, Any]:
    """Compares what auto chose, as it ran, with the best of the fixed choices.

    error ratio: its error over that of the best choice that takes no more time than it does itself; of a run time
    wanted, also of the best that keeps it. time ratio, where an error is wanted: its run time over that of the fastest
    choice with no more error than it has itself or than was wanted. What takes up to EVEN times as long counts as even.
    """
    rivals = [*fixed, own]
    rival = min((f for f in rivals if f.seconds <= EVEN * own.seconds), key=lambda f: f.error)
    found: dict[str, Any] = {
        "best fixed": f"{rival.label} ({rival.error:.4f}, {rival.seconds:.2f} s/s)",
        "error ratio": round(own.error / max(rival.error, 1e-9), 2),
        "error ratio, wanted time": "",
        "time ratio": "",
    }
    if wish.kind == "time" and wish.wanted:
        in_time = min((f.error for f in fixed if f.seconds <= EVEN * wish.wanted), default=own.error)
        found["error ratio, wanted time"] = round(own.error / max(in_time, 1e-9), 2)
    if wish.kind == "error" and wish.wanted:
        as_good = min(f.seconds for f in rivals if f.error <= EVEN * max(wish.wanted, own.error))
        found["time ratio"] = round(own.seconds / as_good, 2)
    return found


def _run(
    world: World, way: tuple[str, float, int], duration_ns: int, truth: EventStream, light: dict[str, Any]
) -> Fixed:
    """Runs a choice in full, with linear crossing times."""
    method, rate, k = way
    run = simulate(world, method, rate, k, duration_ns, ("linear",), None, light)
    error = victor_purpura(run.streams["linear"], truth, 1.0)
    return Fixed(label_of(method, rate, k), run.seconds("linear") / duration_ns * NS, error)


def label_of(method: str, rate: float, k: int) -> str:
    """Makes the label of a choice: method, keyframes per second x K."""
    return f"{'dense' if method == 'none' else method} {rate:g}x{k}"
