"""Chooses the instants at which a pixel is computed: close together where its light changes, and nowhere else.

Every pixel is computed `BASE` times a second. An interval over which ln I changes by more than a part of the
threshold, or at whose ends different bodies are seen, is cut into four. Where ln I is not on the line between the ends
then, parts over which it changes are halved in turn, down to 31 us: a silhouette is placed to within 16 us. What a lamp
does is known: it is looked at before and after each switch, and where a sine is highest, lowest and in between.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from evis.scene.model import Waveform
from nodes.audit.brightness import log_level

BASE = 500.0
"""Least looks at a pixel [Hz]."""

FINEST = 40_000
"""Length up to which an interval is not cut any more [ns]."""

CHANGE = 0.2
"""Part of a contrast threshold up to which a change over an interval makes no events that a line would not."""

BEND = 0.1
"""Part of a contrast threshold by which the middle of an interval may be off the line."""

FASTEST = 2000.0
"""Frequency up to which a lamp's waveform is followed [Hz]; what is faster is seen whenever a pixel is looked at."""

FIRST_PARTS = 4
"""Parts that an interval between two of the least looks is cut into, so that less is missed within it."""

PARTS = 2
"""Parts that an interval is cut into from then on."""

Look = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Gives luminance float32 [Q] and instance int32 [Q] of pixels int64 [Q] at times int64 [Q] ns."""


@dataclass(frozen=True)
class Sampling:
    """Holds how densely a pixel is sampled in time; see the constants of this file."""

    base: float = BASE
    finest: int = FINEST
    change: float = CHANGE
    bend: float = BEND


@dataclass
class Samples:
    """Holds samples of pixels: pixel int64 [S], t int64 [S] ns, luminance float32 [S], instance int32 [S]."""

    pixel: np.ndarray
    t: np.ndarray
    luminance: np.ndarray
    instance: np.ndarray

    @staticmethod
    def none() -> Samples:
        """Makes an empty set of samples."""
        return Samples(*(np.zeros(0, kind) for kind in (np.int64, np.int64, np.float32, np.int32)))

    @staticmethod
    def joined(parts: Sequence[Samples]) -> Samples:
        """Joins several sets into one that is sorted by pixel, then by time."""
        return Samples(
            *(np.concatenate(columns) for columns in zip(*(vars(part).values() for part in parts)))
        ).ordered()

    def only(self, chosen: np.ndarray) -> Samples:
        """Picks samples: bool [S], or their places int64 [n]."""
        return Samples(*(values[chosen] for values in vars(self).values()))

    def ordered(self) -> Samples:
        """Returns the samples sorted by pixel, then by time."""
        # What comes in a few ascending runs is sorted in little time.
        first = int(self.t.min(initial=0))
        order = np.argsort(self.pixel * (int(self.t.max(initial=0)) - first + 1) + (self.t - first), kind="stable")
        return self.only(order)


def base_stamps(stamps: np.ndarray, rate: float) -> np.ndarray:
    """Gives int64 ns after stamps[0] up to stamps[-1], with each of `stamps`, no further apart than 1 / rate [s]."""
    parts = []
    for a, b in zip(stamps[:-1].tolist(), stamps[1:].tolist()):
        n = max(1, -int(-(b - a) * rate // 1_000_000_000))
        parts.append(a + (2 * np.arange(1, n + 1, dtype=np.int64) * (b - a) + n) // (2 * n))
    return np.concatenate(parts) if parts else np.zeros(0, np.int64)


def lamp_stamps(waveforms: Iterable[Waveform | None], start: int, end: int) -> np.ndarray:
    """Gives the instants int64 ns after `start` and before `end` that a lamp's waveform asks for, each once.

    Light that flickers may be alike at all other looks: a pulse between two of them, or a sine of half their rate.
    """
    stamps: set[int] = set()
    for wave in {w for w in waveforms if w is not None and w.depth > 0 and 0 < w.frequency <= FASTEST}:
        frequency, phase = Fraction(wave.frequency), Fraction(wave.phase)
        parts = [Fraction(0), Fraction(wave.duty)] if wave.kind == "square" else [Fraction(k, 4) for k in range(4)]
        first, last = (math.floor(frequency * t / 1_000_000_000 + phase) for t in (start, end))
        for part in (period + part for period in range(first, last + 1) for part in parts):
            # The first nanosecond after it, and the last before.
            t = math.ceil((part - phase) / frequency * 1_000_000_000)
            stamps |= {t - 1, t} if wave.kind == "square" else {t}
    return np.array(sorted(t for t in stamps if start < t < end), np.int64)


def sample(look: Look, start: Samples, stamps: np.ndarray, how: Sampling, threshold: float) -> Samples:
    """Samples the pixels of `start`, one sample of each, at `stamps` int64 [K] ns after it and wherever it is needed.

    Gives all looks after `start`, by pixel and time.
    """
    count, length = len(start.pixel), len(stamps)
    pixel, t = np.repeat(start.pixel, length), np.tile(stamps, count)
    at = Samples(pixel, t, *look(pixel, t))
    rows = [
        np.concatenate([np.asarray(s)[:, None], values.reshape(count, length)], 1)
        for s, values in ((start.t, at.t), (start.luminance, at.luminance), (start.instance, at.instance))
    ]
    levels = log_level(rows[1])
    found = [at]
    part = _Intervals(
        pixel,
        *(v.reshape(-1) for row in (rows[0], levels, rows[2]) for v in (row[:, :-1], row[:, 1:])),
    )
    part = part.changing(how.change * threshold)
    parts = FIRST_PARTS
    while len(part := part.only(part.t_b - part.t_a > how.finest)):
        inner = part.inner(parts)
        pixel = np.repeat(part.pixel, parts - 1)
        light, instance = look(pixel, inner.reshape(-1))
        found.append(Samples(pixel, inner.reshape(-1), light, instance))
        level = log_level(light).reshape(inner.shape)
        line = part.l_a[:, None] + (part.l_b - part.l_a)[:, None] * np.arange(1, parts) / parts
        bent = (np.abs(level - line) > how.bend * threshold).any(1)
        part = part.parts(inner, level, instance.reshape(inner.shape)).only(np.repeat(bent, parts))
        part = part.changing(how.change * threshold)
        parts = PARTS
    return Samples.joined(found)


@dataclass
class _Intervals:
    """Intervals of pixels, with time, ln I and instance at both ends, each [Q]."""

    pixel: np.ndarray
    t_a: np.ndarray
    t_b: np.ndarray
    l_a: np.ndarray
    l_b: np.ndarray
    i_a: np.ndarray
    i_b: np.ndarray

    def __len__(self) -> int:
        return len(self.pixel)

    def only(self, chosen: np.ndarray) -> _Intervals:
        """Picks those that are chosen, bool [Q]."""
        return _Intervals(*(values[chosen] for values in vars(self).values()))

    def changing(self, least: float) -> _Intervals:
        """Picks those over which ln I changes by more than `least`, or at whose ends different things are seen."""
        return self.only((np.abs(self.l_b - self.l_a) > least) | (self.i_a != self.i_b))

    def inner(self, parts: int) -> np.ndarray:
        """Computes times int64 [Q, P - 1] that cut them into P equal parts."""
        return self.t_a[:, None] + (self.t_b - self.t_a)[:, None] * np.arange(1, parts) // parts

    def parts(self, t: np.ndarray, level: np.ndarray, instance: np.ndarray) -> _Intervals:
        """Returns the P parts, with what was seen at the inner times [Q, P - 1]."""
        ends = [np.repeat(self.pixel, t.shape[1] + 1)]
        for a, middle, b in ((self.t_a, t, self.t_b), (self.l_a, level, self.l_b), (self.i_a, instance, self.i_b)):
            row = np.concatenate([a[:, None], middle, b[:, None]], 1)
            ends += [row[:, :-1].reshape(-1), row[:, 1:].reshape(-1)]
        return _Intervals(*ends)
