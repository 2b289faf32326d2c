"""Estimates rotation speed from periodicity: 1 ms descriptors, their Fourier transform along time, the dominant peak.

A pattern that repeats n times on a turn makes a peak at n times the frequency of revolution, and any pattern makes
harmonics: the spectrum alone cannot tell the order of a peak. The speed that was followed from image to image can.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from evis.events.measure.rotation.polar import STEP_NS

CELLS = 12
CANDIDATES = 6
_STRONG = 0.3
"""Power of a peak that counts, over that of the strongest."""
_ORDERS = 15
"""Orders that a speed known to one per cent places."""
NEAR = 0.04
"""Share by which the period of a revolution may differ from the tracked one."""
_PEER = 0.7
"""Returns with this share of the best correlation are as good as it."""


def descriptors(
    t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray, first_ns: int, steps: int
) -> np.ndarray:  # fmt: skip
    """Counts the events per millisecond, polarity and cell of a 12 x 12 grid over the events.

    Args:
        t: times, int64 [n] ns.
        x: pixel columns [n].
        y: pixel rows [n].
        p: polarities, 0 or 1 [n].
        first_ns: time at which the first millisecond begins.
        steps: milliseconds.

    Returns:
        counts, float32 [steps, 2 * 144].
    """

    def cells(v: np.ndarray) -> np.ndarray:
        return np.minimum((v - v.min()) * CELLS // (np.ptp(v) + 1), CELLS - 1).astype(np.int64)

    step = (t - first_ns) // STEP_NS
    key = ((step * 2 + p) * CELLS + cells(y)) * CELLS + cells(x)
    size = 2 * CELLS * CELLS
    return np.bincount(key, minlength=steps * size).astype(np.float32).reshape(steps, size)


def candidates(table: np.ndarray, omega: float | None) -> list[dict[str, Any]]:
    """Finds the strongest peaks of the power spectrum, strongest first.

    table: [steps, columns], 1 ms apart. omega: the followed speed [rad/s], by which `order` is told: how many times
    per revolution that frequency passes; `omega_rad_s` is 2 pi f / order then, and 2 pi f without.
    """
    steps = len(table)
    if steps < 16:
        return []
    size = 1 << (4 * steps - 1).bit_length()
    power = np.zeros(size // 2 + 1)
    taper = np.hanning(steps + 2)[1:-1, None].astype(np.float32)
    for column in range(0, table.shape[1], 24):
        part = table[:, column : column + 24]
        power += (np.abs(np.fft.rfft((part - part.mean(0)) * taper, size, axis=0)) ** 2).sum(1)
    frequency = np.arange(len(power)) * (1e9 / STEP_NS / size)
    inner = power[1:-1]
    tops = np.flatnonzero((inner > power[:-2]) & (inner >= power[2:])) + 1
    tops = tops[frequency[tops] > 1.5e9 / STEP_NS / steps]  # slower ones are the taper's own width
    if not len(tops):
        return []
    tops = tops[np.argsort(-power[tops], kind="stable")][:CANDIDATES]
    result = []
    for top in tops:
        around = np.log(power[top - 1 : top + 2] + 1e-30)
        bend = around[0] - 2 * around[1] + around[2]
        f = float(frequency[top] + (0.5 * (around[0] - around[2]) / bend if bend < 0 else 0) * frequency[1])
        order = max(1, round(2 * np.pi * f / abs(omega))) if omega else None
        result.append(
            {
                "frequency_hz": f,
                "power": float(power[top] / power[tops[0]]),
                "order": order,
                "omega_rad_s": 2 * np.pi * f / (order or 1),
            }
        )
    return result


def off_orders(listed: list[dict[str, Any]], omega: float) -> float:
    """Tells how far the strong peaks are from whole multiples of a steady speed [rad/s]: 0 = on them, 0.25 = by chance.

    Peaks that belong to another speed, or to a wrong pivot, lie anywhere.
    """
    strong = [c for c in listed if c["power"] >= _STRONG and 2 * np.pi * c["frequency_hz"] < _ORDERS * abs(omega)]
    if not strong:
        return 0.0
    orders = np.array([2 * np.pi * c["frequency_hz"] / abs(omega) for c in strong])
    return float(np.average(np.abs(orders - np.rint(orders)), weights=[c["power"] for c in strong]))


@dataclass(frozen=True)
class Recurrence:
    """Holds a period found. period_s: time of one revolution; correlation of the descriptors at that distance, -1 to 1;
    revolutions seen.
    """

    period_s: float
    correlation: float
    revolutions: int


def recurrence(table: np.ndarray, period_s: float) -> Recurrence | None:
    """Finds the period near `period_s` after which the descriptors come again; None if the recording is shorter than
    that.

    Near is 4 %: the tracked speed is that good, and a pattern of twelve spokes comes again 8 % before a revolution.

    Several revolutions are compared where the recording has them, each narrowing the next.
    """
    steps = len(table)
    if period_s * (1 + NEAR) * 1e9 / STEP_NS > 0.92 * steps:
        return None
    size = 1 << (2 * steps - 1).bit_length()
    product = np.zeros(size)
    for column in range(0, table.shape[1], 24):
        part = table[:, column : column + 24]
        product += np.fft.irfft((np.abs(np.fft.rfft(part - part.mean(0), size, axis=0)) ** 2).sum(1), size)
    energy = np.concatenate([[0.0], np.cumsum(((table - table.mean(0)) ** 2).sum(1, dtype=np.float64))])
    lags = np.arange(steps - 3)
    # energies of the two parts that a lag lays on each other
    both = np.sqrt(energy[steps - lags] * (energy[steps] - energy[lags])) + 1e-12
    similar = product[: len(lags)] / both
    period, tolerance, best = period_s * 1e9 / STEP_NS, max(NEAR, 1.5e-9 * STEP_NS / period_s), None
    turns = 1
    while best is None or (turns * period * (1 + tolerance) < 0.92 * steps and turns * period < 0.75 * steps):
        low, high = int(turns * period * (1 - tolerance)), int(np.ceil(turns * period * (1 + tolerance))) + 1
        part = similar[max(low, 1) : min(high, len(similar))]
        if len(part) < 3:
            break
        inner = part[1:-1]
        tops = np.flatnonzero((inner >= part[:-2]) & (inner >= part[2:]) & (inner >= _PEER * inner.max())) + 1
        if not len(tops):
            break
        # of a pattern that repeats, the return that is nearest to the tracked revolution
        top = int(tops[np.abs(tops + max(low, 1) - turns * period).argmin()])
        left, middle, right = part[top - 1 : top + 2]
        bend = left - 2 * middle + right
        lag = max(low, 1) + top + (0.5 * (left - right) / bend if bend < 0 else 0.0)
        period = lag / turns
        tolerance = min(0.05, 3.0 / lag + 0.005)
        best = Recurrence(period * STEP_NS * 1e-9, float(middle), turns)
        turns *= 2
    return best
