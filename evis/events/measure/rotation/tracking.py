"""Tracks the speed of rotation over time: a coarse search of each window's angles, then the events' own alignment."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from evis.events.measure.rotation.alignment import align, in_view
from evis.events.measure.rotation.coherence import coherence
from evis.events.measure.rotation.pivot import STEPS
from evis.events.measure.rotation.plane import Plane
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

POINTS = 250
"""Points of a series at most; 3 ms apart where that is enough."""
_SPACING = 3
_CLEAR = 2.5
"""Least contrast of a window, as a multiple of that of random events."""
_TURN = 0.6
"""Half a window is so long that the image turns by this much [rad] ..."""
_HALF_MS = (8.0, 30.0)
"""... within these limits."""
_RIVAL = 0.9
"""Share of the greatest contrast from which another speed is as good."""
_LEAST_INSIDE = 0.1
"""Share of a window's events that must be in view throughout; otherwise all are taken."""
_SMOOTH_NS = 6_000_000


@dataclass(frozen=True)
class Track:
    """Holds a speed over time: t_ns int64 [n] and omega [n, rad/s, positive from x to y], the speed of the image about
    the pivot.
    """

    t_ns: np.ndarray
    omega: np.ndarray

    def __len__(self) -> int:
        return len(self.t_ns)

    @property
    def angle(self) -> np.ndarray:
        """Returns the angle [n, rad], 0 at the first point; gaps of the series are bridged by the mean of their
        ends."""
        if len(self) < 2:
            return np.zeros(len(self))
        step = np.diff(self.t_ns) * 1e-9
        return np.concatenate([[0.0], np.cumsum((self.omega[1:] + self.omega[:-1]) / 2 * step)])


@dataclass(frozen=True)
class Tracked:
    """Holds a track, and what speaks for it or against it.

    covered: share of the events that it covers; torn: share of windows that another speed explains as well, as of a
    pattern that moves by about half its own period within a descriptor; coherence: see there, NaN where too little
    was seen.
    """

    series: Track
    covered: float
    torn: float
    coherence: float


def track(
    t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray, plane: Plane, fastest: float,
    working: Callable[[str], None] = lambda text: None,
) -> Tracked:  # fmt: skip
    """Follows the speed over the events: t int64 [n, ns] ascending, x, y float [px], p; fastest: largest speed [rad/s].

    working: is told what goes on.
    """
    steps = int((t[-1] - t[0]) // STEP_NS) + 1
    which = ((t - t[0]) // STEP_NS).astype(np.int64)
    u, v = plane.from_image(x, y)
    coefficients, counts = harmonics_of(which, steps, u, v, p, rings_of(u, v))
    orders = order_weights(16)
    omegas = np.arange(-fastest, fastest + 1, max(1.0, fastest / 60))
    turned = turns(omegas, STEPS, len(orders))
    around = np.convolve(counts, np.ones(STEPS), "same")
    middles = np.flatnonzero(around >= 60)
    middles = middles[(middles >= STEPS // 2) & (middles < steps - STEPS // 2)]
    spacing = max(_SPACING, -(-len(middles) // POINTS))
    view = np.array([x.min(), x.max(), y.min(), y.max()])
    times, speeds, weights, torn = [], [], [], 0
    middles = middles[middles % spacing == 0]
    for k, middle in enumerate(middles.tolist()):
        if k % 8 == 0:
            working(f"speed {k / len(middles):.0%}")
        window = slice(middle - STEPS // 2, middle + STEPS // 2 + 1)
        taper = time_weights(counts[window])
        energy = contrast(coefficients[:, window], taper, turned, orders)
        chance = orders.sum() * (taper**2 * counts[window]).sum()
        if energy.max() < _CLEAR * chance:
            continue
        omega = peak(omegas, energy)
        at = int(t[0]) + middle * STEP_NS + STEP_NS // 2
        half = float(np.clip(_TURN / max(abs(omega), 1) * 1e3, *_HALF_MS)) * 1e-3
        first, last = np.searchsorted(t, [at - int(half * 1e9), at + int(half * 1e9)])
        part = np.arange(first, last)
        inner = part[in_view((t[part] - at) * 1e-9, u[part], v[part], half, omega, plane, view)]
        part = inner if len(inner) > _LEAST_INSIDE * len(part) else part
        free, _ = align((t[part] - at) * 1e-9, u[part], v[part], p[part], half, omega)
        if np.isfinite(free) and abs(free) < 2 * fastest:
            times.append(at)
            speeds.append(free)
            weights.append(counts[window].sum())
            torn += rival(energy) > _RIVAL
    covered = min(1.0, float(np.sum(weights)) * spacing / STEPS / max(counts.sum(), 1))
    reach = max(_SMOOTH_NS, 3 * spacing * STEP_NS // 2)
    series = smooth(Track(np.array(times, np.int64), np.array(speeds)), reach)
    at_ns = int(t[0]) + np.arange(steps) * STEP_NS + STEP_NS // 2
    turned_by = np.interp(at_ns, series.t_ns, series.angle, np.nan, np.nan) if times else np.full(steps, np.nan)
    return Tracked(series, covered, torn / max(len(times), 1), coherence(coefficients, turned_by))


def rival(energy: np.ndarray) -> float:
    """Computes the second highest peak of a window's contrast over the highest, 0 to 1."""
    inner = energy[1:-1]
    tops = np.sort(inner[(inner > energy[:-2]) & (inner >= energy[2:])])
    return float(tops[-2] / energy.max()) if len(tops) > 1 else 0.0


def smooth(series: Track, reach_ns: int) -> Track:
    """Smooths a track by a median of five against outliers, then a straight line through all within reach."""
    if len(series) < 3:
        return series
    t, omega = series.t_ns, series.omega
    around = [omega[np.abs(t - at) <= reach_ns] for at in t]
    middle = np.array([np.median(values) for values in around])
    spread = np.array([np.median(np.abs(values - m)) for values, m in zip(around, middle)])
    sane = np.abs(omega - middle) <= 4 * spread + 0.05 * np.abs(middle) + 0.2
    result = np.empty(len(t))
    for i, at in enumerate(t):
        near = sane & (np.abs(t - at) <= reach_ns)
        tau = (t[near] - at) * 1e-9
        result[i] = np.polynomial.polynomial.polyfit(tau, omega[near], 1)[0] if near.sum() > 2 else middle[i]
    return Track(t, result)


def consistency(series: Track) -> float:
    """Computes the share of points that agree with the median of their five neighbours within 20 % and 1 rad/s, 0
    to 1.
    """
    if len(series) < 5:
        return 0.0
    windows = np.lib.stride_tricks.sliding_window_view(series.omega, 5)
    middle = np.median(windows, axis=1)
    return float((np.abs(windows[:, 2] - middle) <= 0.2 * np.abs(middle) + 1).mean())
