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

    known: a fixed choice that was run already. Every choice is run in full. error ratio: its error over that of the
    best fixed choice that takes no more time than it does itself; of a run time wanted, also of the best that keeps it.
    time ratio, where an error is wanted: its run time over that of the fastest fixed choice with no more error than it
    has itself or than was wanted.
    """
    scene = world.scene
    sensor = {"threshold": THRESHOLD, "crossing": "linear"}
    setting = Setting(scene, scene.camera("cam0"), duration_ns, sensor=sensor, light=light)
    began = setting.clock()
    measured = probe(setting)
    spent = setting.clock() - began
    moving = measured.moving
    by_time, by_error = sorted(fixed, key=lambda f: f.seconds), sorted(fixed, key=lambda f: f.error)
    wishes: list[tuple[str, float | None]] = [("rule", None)]
    wishes += [("time", by_time[len(by_time) * part // 4].seconds) for part in (1, 2, 3)]
    wishes += [("error", by_error[len(by_error) * part // 4].error) for part in (1, 2)]
    rows = []
    for kind, wanted in wishes:
        began, tried = setting.clock(), len(measured.trials)
        error, rtf = (
            (wanted if kind == "error" else None),
            (1 / (wanted + moving) if kind == "time" and wanted else None),
        )
        best = settle(setting, measured, error, rtf).candidate
        trials = setting.clock() - began
        way = (best.method, best.keyframe_rate, best.upsampling)
        if best.method == "none":
            way = ("none", best.frame_rate, 1)
        own = known(*way) or _run(world, way, duration_ns, truth, light)
        rivals = [*fixed, own]
        rival = min((f for f in rivals if f.seconds <= EVEN * own.seconds), key=lambda f: f.error)
        line: dict[str, Any] = {
            "scene": name,
            "wanted": {"rule": "its own rule", "time": f"{wanted or 0:.2f} s/s", "error": f"VP {wanted or 0:.3f}"}[
                kind
            ],
            "auto": own.label,
            "predicted [s/s]": round(best.seconds - moving, 2),
            "run time [s/s]": round(own.seconds, 2),
            "predicted VP 1/ms": round(best.error, 4),
            "VP 1/ms": round(own.error, 4),
            "best fixed": f"{rival.label} ({rival.error:.4f}, {rival.seconds:.2f} s/s)",
            "error ratio": round(own.error / max(rival.error, 1e-9), 2),
            "error ratio, wanted time": "",
            "time ratio": "",
            "measuring took [s]": f"{spent:.1f} + {trials:.1f} ({len(measured.trials) - tried} trials)",
        }
        if kind == "time" and wanted:
            in_time = min((f.error for f in fixed if f.seconds <= EVEN * wanted), default=own.error)
            line["error ratio, wanted time"] = round(own.error / max(in_time, 1e-9), 2)
        if kind == "error" and wanted:
            as_good = min(f.seconds for f in rivals if f.error <= EVEN * max(wanted, own.error))
            line["time ratio"] = round(own.seconds / as_good, 2)
        rows.append(line)
    return rows


def _run(
    world: World, way: tuple[str, float, int], duration_ns: int, truth: EventStream, light: dict[str, Any]
) -> Fixed:
    method, rate, k = way
    run = simulate(world, method, rate, k, duration_ns, ("linear",), None, light)
    error = victor_purpura(run.streams["linear"], truth, 1.0)
    return Fixed(label_of(method, rate, k), run.seconds("linear") / duration_ns * NS, error)


def label_of(method: str, rate: float, k: int) -> str:
    """Makes the label of a choice: method, keyframes per second x K."""
    return f"{'dense' if method == 'none' else method} {rate:g}x{k}"
