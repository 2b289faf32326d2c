"""Computes the statistics by which a recording and its simulation are compared: rates, bursts, intervals."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from evis.events.measure.bursts import Bursts, bursts_of

SCALES: dict[str, float] = {
    "on_per_turn": 0.03,
    "off_per_turn": 0.03,
    "burst_on_ms": 0.05,
    "burst_off_ms": 0.05,
    "burst_on_slow_ms": 0.1,
    "burst_off_slow_ms": 0.1,
    "burst_on_fast_ms": 0.1,
    "burst_off_fast_ms": 0.1,
    "spread_on": 0.4,
    "spread_off": 0.4,
    "interval_on_10_ms": 0.2,
    "interval_on_50_ms": 0.2,
    "interval_on_90_ms": 0.2,
    "interval_off_10_ms": 0.2,
    "interval_off_50_ms": 0.2,
    "interval_off_90_ms": 0.2,
}
"""Statistic -> what a fit counts as one off [ln]: how much it should matter, not how well it is measured."""
CHANCE = 0.3
"""Of these, how much statistics of other pixels of the same sensor and scene differ: less is left where unknowns follow
chance, and tells nothing."""
BLUR = tuple(name for name in SCALES if name.startswith("interval") or "slow" in name or "fast" in name)
"""By these alone the blur of a scene is found where the sensor is given."""
TEXTS = {
    "on_per_turn": "ON events per pixel and turn",
    "off_per_turn": "OFF events per pixel and turn",
    "on_share": "share of ON",
    "burst_on_ms": "median burst ON [ms]",
    "burst_off_ms": "median burst OFF [ms]",
}
FEW = 30
"""Intervals or bursts below which a statistic is not known."""


def statistics(
    t: np.ndarray, pixel: np.ndarray, p: np.ndarray, pixels: int, turns: float, slow: Callable[[Bursts], np.ndarray]
) -> dict[str, float]:
    """Computes the statistics of the events of `pixels` pixels during a motion of so many turns.

    t: int64 [n, ns], ascending; pixel: int [n]; p: [n], 1 = ON. slow: tells of bursts, bool [B], whether a slow edge
    made them. What too few bursts leave unknown is NaN.
    """
    found = bursts_of(t, pixel, p)
    of_slow = slow(found)
    out: dict[str, float] = {}
    for side, name in ((1, "on"), (0, "off")):
        bursts, intervals = found.p == side, found.interval[found.interval_p == side] * 1e-6
        out[f"{name}_per_turn"] = float((p == side).sum() / (pixels * turns))
        out[f"burst_{name}_ms"] = _median(found.length[bursts])
        out[f"burst_{name}_slow_ms"] = _median(found.length[bursts & of_slow])
        out[f"burst_{name}_fast_ms"] = _median(found.length[bursts & ~of_slow])
        out[f"spread_{name}"] = float(np.std(found.count[bursts])) if bursts.sum() >= FEW else float("nan")
        for quantile in (10, 50, 90):
            value = float(np.percentile(intervals, quantile)) if len(intervals) >= FEW else float("nan")
            out[f"interval_{name}_{quantile}_ms"] = value
    out["on_share"] = out["on_per_turn"] / max(out["on_per_turn"] + out["off_per_turn"], 1e-300)
    return out


def _median(lengths: np.ndarray) -> float:
    return float(np.median(lengths) * 1e-6) if len(lengths) >= FEW else float("nan")


def differences(
    simulated: Mapping[str, float], real: Mapping[str, float], names: tuple[str, ...] = tuple(SCALES)
) -> np.ndarray:
    """Computes ln(simulated / real) of each statistic over its scale: float64 [n]; 0 where the recording does not
    tell."""
    out = np.zeros(len(names))
    for i, name in enumerate(names):
        if real[name] > 0:
            value = simulated[name] if simulated[name] > 0 else 10 * real[name]  # none at all is far off
            out[i] = np.log(value / real[name]) / SCALES[name]
    return out
