"""Computes the stamps of keyframes and sub-frames, in exact integer arithmetic."""

from __future__ import annotations

import functools
from fractions import Fraction

import numpy as np

NS = 1_000_000_000
"""Nanoseconds per second."""


@functools.lru_cache(maxsize=64)
def rate(value: float) -> Fraction:
    """Returns a rate [Hz] as an exact fraction: 30, 29.97, 1000/3 as a user means them, not as binary floats."""
    return Fraction(value).limit_denominator(1_000_000)


@functools.lru_cache(maxsize=4096)
def keyframe_stamp(k: int, keyframe_rate: float) -> int:
    """Returns the stamp [ns] of keyframe k: round(k * 1e9 / keyframe_rate), ties to even, exact at any k."""
    return round(Fraction(k * NS) / rate(keyframe_rate))


def keyframe_count(duration_ns: int, keyframe_rate: float) -> int:
    """Counts the keyframes that have a stamp <= duration_ns; the one at 0 counts."""
    k = int(Fraction(duration_ns) * rate(keyframe_rate) / NS) + 2
    while keyframe_stamp(k - 1, keyframe_rate) > duration_ns:
        k -= 1
    return k


def times_slower(keyframe_rate: float, slower_rate: float) -> int:
    """Computes how many keyframes at keyframe_rate [Hz] there are for each at slower_rate [Hz].

    Raises ValueError naming both and the nearest that fit, unless it is a whole number of at least 1.
    """
    fast, slow = rate(keyframe_rate), rate(slower_rate)
    if slow > 0 and (ratio := fast / slow).denominator == 1:
        return ratio.numerator
    text = f"{slower_rate:.12g} Hz is no whole fraction of keyframe_rate, {keyframe_rate:.12g} Hz; "
    if slow <= 0:
        raise ValueError(f"{text}it must be above 0")
    n = fast // slow
    lower, upper = float(fast / (n + 1)), float(fast / n) if n else 0.0
    near = f"nearest are {lower:.12g} and {upper:.12g}" if n else f"nearest is {lower:.12g}"
    raise ValueError(f"{text}the {near} Hz, and keyframe_rate:={float(slow * (n + 1)):.12g} would fit")


def subframe_stamps(t_a: int | np.ndarray, t_b: int | np.ndarray, upsampling: int) -> np.ndarray:
    """Returns the int64 [K] stamps t_A + (i/K)(t_B - t_A), i = 1..K, rounded half up; the last is t_B itself.

    Of several gaps at once, with t_a and t_b int64 [n, 1], [n, K].
    """
    i = np.arange(1, upsampling + 1, dtype=np.int64)
    return t_a + (2 * i * (t_b - t_a) + upsampling) // (2 * upsampling)
