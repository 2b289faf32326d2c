"""Estimates where and in which plane events turn, how fast on the whole, and whether that explains them better than
sliding."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from evis.events.measure.rotation.plane import FRONT, Plane
from evis.events.measure.rotation.polar import (
    STEP_NS,
    contrast,
    harmonics_of,
    order_weights,
    peak,
    rings_of,
    time_weights,
    turns,
)

WINDOWS = 10
STEPS = 25
"""Length of a window in descriptors."""
EVENTS = 1200
"""Events of a window that are looked at."""
FASTEST = 400.0
"""Largest speed searched for [rad/s]."""
_BIN = 2.0
"""Pixels of the images compared, a side."""
_STARTS = 4
"""Places from which tilted planes are tried."""
_STRETCHES = (0.18, 0.36, 0.54)
"""Lengths of the stretches tried: tilts of 46, 61 and 70 degrees."""
_WORTH = 1.1
"""Factor by which a tilted plane must explain the events better than one seen from the front: it has two more
numbers."""
_BENT = 0.1
"""Turn within a window [rad] from which an ellipse can be told: less than that looks like a shear."""


@dataclass(frozen=True)
class Window:
    """Holds the events about t_ns: tau [n, s] from there, x, y [px], p, and the descriptor that each belongs to."""

    tau: np.ndarray
    x: np.ndarray
    y: np.ndarray
    p: np.ndarray
    step: np.ndarray


@dataclass(frozen=True)
class Found:
    """Holds a plane and the speeds that were found. plane; omegas [windows, rad/s]; pairs of events that share a pixel,
    per window and model [windows].
    """

    plane: Plane
    omegas: np.ndarray
    turned: np.ndarray
    slid: np.ndarray
    still: np.ndarray

    @property
    def gain(self) -> float:
        """Returns the share of the pairs that only turning brings together, 0 to 1."""
        turned = float(self.turned.sum())
        return max(0.0, 1 - max(float(self.slid.sum()), float(self.still.sum())) / turned) if turned > 0 else 0.0


def pick_windows(t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray) -> list[Window]:
    """Picks windows of 25 ms at equal shares of the events; t int64 [n, ns] ascending."""
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


def find_planes(windows: list[Window], working: Callable[[str], None] = lambda text: None) -> list[Found]:
    """Finds the pivot inside (or a little outside) the events and the plane in which turning about it gathers them
    best.

    A grid of pivots that is refined around the best; from the best few of the coarse grid, tilted planes too. A tilted
    plane that explains the events clearly better comes first, and the one seen from the front is always there.
    working: is told what goes on.
    """
    every_x, every_y = (np.concatenate([getattr(w, n) for w in windows]) for n in "xy")
    low = np.array([np.quantile(every_x, 0.02), np.quantile(every_y, 0.02)])
    high = np.array([np.quantile(every_x, 0.98), np.quantile(every_y, 0.98)])
    pitch = (high - low) / 4
    working("pivot")
    search = _Search(windows, FASTEST, 4.0)
    reach = np.arange(-2, 3)
    coarse = sorted(
        (search.at(Plane((low + high) / 2 + pitch * (i, j))) for i in reach for j in reach),
        key=lambda tried: -tried.score,
    )
    search = search.slower(coarse[0])
    front = _refined(search, coarse[0], pitch, 0.0)
    best = front
    ways = np.arange(8) * (2 * np.pi / 8)
    for k, start in enumerate(coarse[:_STARTS]):
        working(f"tilt {k / _STARTS:.0%}")
        for length in _STRETCHES:
            for way in ways:
                stretch = (length * float(np.cos(way)), length * float(np.sin(way)))
                best = max(best, search.at(Plane(start.plane.pivot, stretch)), key=lambda tried: tried.score)
    if best.plane.stretch != FRONT:
        best = _refined(search, best, pitch, 0.18)
    bent = float(np.median(np.abs(best.omegas))) * STEPS * STEP_NS * 1e-9 >= _BENT
    tried = [best, front] if bent and best.score >= _WORTH * front.score else [front]
    working("sliding")
    slid = np.array([_slide(window) for window in windows])
    still = np.array([_pairs(w.x, w.y, w.p) for w in windows])
    return [Found(t.plane, t.omegas, t.pairs, slid, still) for t in tried]


@dataclass(frozen=True)
class _Tried:
    """Holds a plane, and of each window the best speed about it [rad/s] and the pairs that it brings together."""

    plane: Plane
    omegas: np.ndarray
    pairs: np.ndarray

    @property
    def score(self) -> float:
        return float(self.pairs.sum())


class _Search:
    """Tries planes at speeds up to `fastest` [rad/s], `step` apart."""

    def __init__(self, windows: list[Window], fastest: float, step: float) -> None:
        self._windows = windows
        self._orders = order_weights(10)[:24]
        self._omegas = np.arange(-fastest, fastest + 1, step)
        self._turns = turns(self._omegas, STEPS, len(self._orders))

    def slower(self, tried: _Tried) -> _Search:
        """Makes a finer search of the speeds that were found, and of somewhat greater ones."""
        fastest = 1.4 * float(np.abs(tried.omegas).max()) + 20
        return _Search(self._windows, fastest, max(1.0, fastest / 60))

    def at(self, plane: Plane) -> _Tried:
        found = [self._turn(window, plane) for window in self._windows]
        return _Tried(plane, np.array([omega for omega, _ in found]), np.array([pairs for _, pairs in found]))

    def _turn(self, window: Window, plane: Plane) -> tuple[float, float]:
        u, v = plane.from_image(window.x, window.y)
        coefficients, counts = harmonics_of(window.step, STEPS, u, v, window.p, rings_of(u, v))
        energy = contrast(coefficients[: len(self._orders)], time_weights(counts), self._turns, self._orders)
        omega = peak(self._omegas, energy)
        cos, sin = np.cos(omega * window.tau), np.sin(omega * window.tau)
        return omega, _pairs(*plane.to_image(cos * u + sin * v, cos * v - sin * u), window.p)


def _refined(search: _Search, best: _Tried, pitch: np.ndarray, bend: float) -> _Tried:
    """Searches the best plane near one: pivots within `pitch` [2, px] and stretches within `bend`, halved three times.

    Once more where there is a tilt: an error of two degrees sways a speed by one per cent.
    """
    around = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j]
    best = search.at(best.plane)
    for _ in range(4 if bend else 3):
        pitch, bend = pitch / 2, bend / 2
        for _ in range(3 if bend else 1):
            before = best.plane
            a, b = before.stretch
            places = [Plane(before.pivot + pitch * step, before.stretch) for step in around]
            places += [Plane(before.pivot, (a + bend * i, b + bend * j)) for i, j in around if bend]
            best = max([best, *map(search.at, places)], key=lambda tried: tried.score)
            if best.plane is before:
                break
    return best


def _slide(window: Window) -> float:
    """Counts the pairs that the best constant velocity of the image brings together, as `_turn` does for the best
    speed."""
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
    """Counts ordered pairs of events of one polarity in one bin: unlike a sum of squares, 0 where nothing gathers."""
    column, row = np.floor(x / _BIN).astype(np.int64), np.floor(y / _BIN).astype(np.int64)
    column, row = column - column.min(), row - row.min()
    width, height = int(column.max()) + 1, int(row.max()) + 1
    key = (row * width + column) * 2 + p
    few = width * height > 40 * len(x)
    counts = np.unique(key, return_counts=True)[1] if few else np.bincount(key)
    return float((counts * (counts - 1)).sum())
