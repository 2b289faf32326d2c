"""Stamps of keyframes and sub-frames in exact integer arithmetic, and pacing against the wall clock."""

from __future__ import annotations

import time
from fractions import Fraction

import numpy as np

NS = 1_000_000_000
"""Nanoseconds per second."""


def rate(value: float) -> Fraction:
    """A rate [Hz] as an exact fraction: 30, 29.97, 1000/3 as a user means them, not as binary floats."""
    return Fraction(value).limit_denominator(1_000_000)


def keyframe_stamp(k: int, keyframe_rate: float) -> int:
    """Stamp [ns] of keyframe k: round(k * 1e9 / keyframe_rate), ties to even, without float error at any k."""
    return round(Fraction(k * NS) / rate(keyframe_rate))


def keyframe_count(duration_ns: int, keyframe_rate: float) -> int:
    """How many keyframes have a stamp <= duration_ns; the one at 0 counts."""
    k = int(Fraction(duration_ns) * rate(keyframe_rate) / NS) + 2
    while keyframe_stamp(k - 1, keyframe_rate) > duration_ns:
        k -= 1
    return k


def subframe_stamps(t_a: int, t_b: int, upsampling: int) -> np.ndarray:
    """int64 [K] stamps t_A + (i/K)(t_B - t_A), i = 1..K, rounded half up; the last is t_B itself."""
    i = np.arange(1, upsampling + 1, dtype=np.int64)
    return t_a + (2 * i * (t_b - t_a) + upsampling) // (2 * upsampling)


class Pacer:
    """Holds a source back so that stamps follow the wall clock; tells how late it is."""

    def __init__(self, speed: float = 1.0) -> None:
        self.speed = speed
        self._start: tuple[int, int] | None = None

    def wait_s(self, stamp_ns: int) -> float:
        """Seconds until `stamp_ns` is due; negative = late. The first call defines the origin."""
        now = time.monotonic_ns()
        if self._start is None:
            self._start = (now, stamp_ns)
        due = self._start[0] + (stamp_ns - self._start[1]) / self.speed
        return (due - now) / NS
