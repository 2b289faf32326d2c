"""The instants at which a pixel is looked at: close together where its light changes, and nowhere else.

Every pixel is looked at `BASE` times a second. An interval over which ln I changes by more than a part of the
threshold, or at whose ends different bodies are seen, is halved. The halves are halved in turn where ln I in the middle
is not on the line between the ends, until they are `FINEST` long: a silhouette is then placed to within 31 us.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

BASE = 1000.0
"""Least looks at a pixel [Hz]."""

FINEST = 62_500
"""Length of the shortest interval [ns]: 16 kHz."""

CHANGE = 0.1
"""Part of a contrast threshold up to which a change over an interval makes no events that a line would not."""

BEND = 0.05
"""Part of a contrast threshold by which the middle of an interval may be off the line."""

Look = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Gives luminance float32 [Q] and instance int32 [Q] of pixels int64 [Q] at times int64 [Q] ns."""


@dataclass(frozen=True)
class Sampling:
    """Holds how closely a pixel is looked at; see the constants of this file."""

    base: float = BASE
    finest: int = FINEST
    change: float = CHANGE
    bend: float = BEND


@dataclass
class Samples:
    """Holds looks at pixels: pixel int64 [S], t int64 [S] ns, luminance float32 [S], instance int32 [S]."""

    pixel: np.ndarray
    t: np.ndarray
    luminance: np.ndarray
    instance: np.ndarray

    def ordered(self) -> Samples:
        """Gives them by pixel and time."""
        order = np.lexsort((self.t, self.pixel))
        return Samples(*(a[order] for a in (self.pixel, self.t, self.luminance, self.instance)))


def base_stamps(stamps: np.ndarray, rate: float) -> np.ndarray:
    """Gives int64 ns after stamps[0] up to stamps[-1], with each of `stamps`, no further apart than 1 / rate [s]."""
    parts = []
    for a, b in zip(stamps[:-1].tolist(), stamps[1:].tolist()):
        n = max(1, -int(-(b - a) * rate // 1_000_000_000))
        parts.append(a + (2 * np.arange(1, n + 1, dtype=np.int64) * (b - a) + n) // (2 * n))
    return np.concatenate(parts) if parts else np.zeros(0, np.int64)


def sample(look: Look, start: Samples, stamps: np.ndarray, how: Sampling, threshold: float) -> Samples:
    """Looks at the pixels of `start`, one look at each, at `stamps` int64 [K] ns after it and wherever it is needed.

    Gives all looks after `start`, by pixel and time.
    """
    count, length = len(start.pixel), len(stamps)
    at = Samples(np.repeat(start.pixel, length), np.tile(stamps, count), *_nothing(0))
    at.luminance, at.instance = look(at.pixel, at.t)
    rows = [
        np.concatenate([np.asarray(s)[:, None], values.reshape(count, length)], 1)
        for s, values in ((start.t, at.t), (start.luminance, at.luminance), (start.instance, at.instance))
    ]
    levels = _log(rows[1])
    found = [at]
    pixel = np.repeat(start.pixel, length)
    ends = [values.reshape(-1) for row in (rows[0], levels, rows[2]) for values in (row[:, :-1], row[:, 1:])]
    t_a, t_b, l_a, l_b, i_a, i_b = ends
    chosen = (np.abs(l_b - l_a) > how.change * threshold) | (i_a != i_b)
    while True:
        chosen &= t_b - t_a > how.finest
        if not chosen.any():
            break
        pixel, t_a, t_b, l_a, l_b, i_a, i_b = (v[chosen] for v in (pixel, t_a, t_b, l_a, l_b, i_a, i_b))
        t_m = (t_a + t_b) // 2
        light, i_m = look(pixel, t_m)
        found.append(Samples(pixel, t_m, light, i_m))
        l_m = _log(light)
        bent = np.abs(l_m - (l_a + l_b) / 2) > how.bend * threshold
        bent = np.concatenate([bent, bent])
        pixel, t_a, t_b = np.concatenate([pixel, pixel]), np.concatenate([t_a, t_m]), np.concatenate([t_m, t_b])
        l_a, l_b = np.concatenate([l_a, l_m]), np.concatenate([l_m, l_b])
        i_a, i_b = np.concatenate([i_a, i_m]), np.concatenate([i_m, i_b])
        changes = np.abs(l_b - l_a) > how.change * threshold
        chosen = bent & (changes | (i_a != i_b))
    names = ("pixel", "t", "luminance", "instance")
    return Samples(*(np.concatenate([getattr(f, name) for f in found]) for name in names)).ordered()


def _log(luminance: np.ndarray) -> np.ndarray:
    """ln I in float64, of dark or senseless light that of the sensor's floor."""
    return np.log(np.fmax(luminance.astype(np.float64), 2.0**-24))


def _nothing(count: int) -> tuple[np.ndarray, np.ndarray]:
    return np.zeros(count, np.float32), np.zeros(count, np.int32)
