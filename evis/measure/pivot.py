"""Where events turn about, how fast on the whole, and whether turning explains them better than sliding does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evis.measure.polar import STEP_NS, contrast, harmonics_of, order_weights, peak, rings_of, time_weights

WINDOWS = 10
STEPS = 25
"""Length of a window in descriptors."""
EVENTS = 1200
"""Events of a window that are looked at."""
FASTEST = 400.0
"""Largest speed searched for [rad/s]."""
_BIN = 2.0
"""Pixels of the images compared, a side."""


@dataclass(frozen=True)
class Window:
    """Events about t_ns: tau [n, s] from there, x, y [px], p, and the descriptor that each belongs to."""

    tau: np.ndarray
    x: np.ndarray
    y: np.ndarray
    p: np.ndarray
    step: np.ndarray


@dataclass(frozen=True)
class Found:
    """pivot [2, px]; omegas [windows, rad/s]; pairs of events that share a pixel, per window and model [windows]."""

    pivot: np.ndarray
    omegas: np.ndarray
    turned: np.ndarray
    slid: np.ndarray
    still: np.ndarray

    @property
    def gain(self) -> float:
        """Share of the pairs that only turning brings together, 0 to 1."""
        turned = float(self.turned.sum())
        return max(0.0, 1 - max(float(self.slid.sum()), float(self.still.sum())) / turned) if turned > 0 else 0.0


def pick_windows(t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray) -> list[Window]:
    """Windows of 25 ms at equal shares of the events; t int64 [n, ns] ascending."""
    half = STEPS * STEP_NS // 2
    if t[-1] - t[0] < 2 * half:
        return []
    centres = t[((np.arange(WINDOWS) + 0.5) / WINDOWS * len(t)).astype(int)].clip(t[0] + half, t[-1] - half)
    result = []
    for centre in np.unique(centres):
        first, last = np.searchsorted(t, [centre - half, centre + half])
        part = np.arange(first, last, max(1, -(-(last - first) // EVENTS)))
        if len(part) >= 50:
            step = np.minimum((t[part] - (centre - half)) // STEP_NS, STEPS - 1)
            result.append(Window((t[part] - centre) * 1e-9, x[part], y[part], p[part], step))
    return result


def find_pivot(windows: list[Window]) -> Found:
    """The pivot inside (or a little outside) the events about which turning gathers them best.

    A grid that is refined around the best place; per place and window the speed of greatest contrast of angles.
    """
    every_x, every_y = (np.concatenate([getattr(w, n) for w in windows]) for n in "xy")
    low = np.array([np.quantile(every_x, 0.02), np.quantile(every_y, 0.02)])
    high = np.array([np.quantile(every_x, 0.98), np.quantile(every_y, 0.98)])
    centre, pitch = (low + high) / 2, (high - low) / 4
    omegas = np.arange(-FASTEST, FASTEST + 1, 4.0)
    best, score, place, fastest = None, -1.0, centre, FASTEST
    for level, reach in enumerate((2, 1, 1, 1)):
        centre = place
        for i in range(-reach, reach + 1):
            for j in range(-reach, reach + 1):
                pivot = centre + pitch * (i, j)
                found = [_turn(window, pivot, omegas) for window in windows]
                total = sum(pairs for _, pairs in found)
                if total > score:
                    best, score, place = found, total, pivot
        assert best is not None
        if level == 0:
            fastest = 1.4 * max(abs(omega) for omega, _ in best) + 20
            omegas = np.arange(-fastest, fastest + 1, max(1.0, fastest / 60))
        pitch = pitch / 2
    assert best is not None
    slid = np.array([_slide(window) for window in windows])
    still = np.array([_pairs(w.x, w.y, w.p) for w in windows])
    return Found(place, np.array([o for o, _ in best]), np.array([s for _, s in best]), slid, still)


def _turn(window: Window, pivot: np.ndarray, omegas: np.ndarray) -> tuple[float, float]:
    edges = rings_of(window.x, window.y, pivot)
    coefficients, counts = harmonics_of(window.step, STEPS, window.x, window.y, window.p, pivot, edges)
    orders = order_weights(10)[:24]
    omega = peak(omegas, contrast(coefficients[:24], time_weights(counts), omegas, orders))
    cos, sin = np.cos(omega * window.tau), np.sin(omega * window.tau)
    dx, dy = window.x - pivot[0], window.y - pivot[1]
    return omega, _pairs(pivot[0] + cos * dx + sin * dy, pivot[1] - sin * dx + cos * dy, window.p)


def _slide(window: Window) -> float:
    """As `_turn`, for the best constant velocity of the image."""
    best, centre = -1.0, np.zeros(2)
    pitch = np.array([np.ptp(window.x), np.ptp(window.y)]) / max(np.ptp(window.tau), 1e-9) / 6
    for reach in (5, 2, 2, 2):
        middle = centre
        for i in range(-reach, reach + 1):
            for j in range(-reach, reach + 1):
                v = middle + pitch * (i, j)
                pairs = _pairs(window.x - v[0] * window.tau, window.y - v[1] * window.tau, window.p)
                if pairs > best:
                    best, centre = pairs, v
        pitch = pitch / 2.5
    return best


def _pairs(x: np.ndarray, y: np.ndarray, p: np.ndarray) -> float:
    """Ordered pairs of events of one polarity in one bin: unlike a sum of squares, 0 where nothing gathers."""
    column, row = np.floor(x / _BIN).astype(np.int64), np.floor(y / _BIN).astype(np.int64)
    column, row = column - column.min(), row - row.min()
    width, height = int(column.max()) + 1, int(row.max()) + 1
    key = (row * width + column) * 2 + p
    few = width * height > 40 * len(x)
    counts = np.unique(key, return_counts=True)[1] if few else np.bincount(key)
    return float((counts * (counts - 1)).sum())
