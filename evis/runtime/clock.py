"""Computes stamps of keyframes and sub-frames in exact integer arithmetic, and paces against the wall clock."""

from __future__ import annotations

import functools
import time
from fractions import Fraction

import numpy as np

from msgs.header import Header

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
    """Returns how many keyframes at keyframe_rate [Hz] there are for each at slower_rate [Hz].

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


class Sampling:
    """Says which messages of a topic are due to somebody who reads `rate_hz` of them a second in stamps and no more."""

    def __init__(self, rate_hz: float) -> None:
        self._period_ns = round(1e9 / rate_hz)
        self._due: tuple[int, int] | None = None

    def takes(self, header: Header) -> bool:
        """Says whether this message is due; messages are asked about in their order.

        One that is not due changes nothing, so that it need not be asked about.
        """
        if self._due is None or self._due[0] != header.episode:
            self._due = (header.episode, header.stamp_ns)
        late = header.stamp_ns - self._due[1]
        if late < 0:
            return False
        # The next is due at a multiple of the period after the first, whatever the topic's rate is.
        self._due = (header.episode, self._due[1] + self._period_ns * (late // self._period_ns + 1))
        return True


class Pacer:
    """Holds a source back so that stamps follow the wall clock, and measures how well they did.

    speed: stamps' seconds per second of the wall clock. late_ms_max: how late the latest stamp was, of all [ms].
    """

    def __init__(self, speed: float = 1.0) -> None:
        self.speed = speed
        self.late_ms_max = 0
        self._start: tuple[int, int] | None = None
        self._before = (0.0, 0.0)
        self._passed = (0.0, 0.0)

    def wait_s(self, stamp_ns: int) -> float:
        """Returns the seconds until `stamp_ns` is due; negative = late. The first call defines the origin."""
        now = time.monotonic_ns()
        if self._start is None:
            self._start = (now, stamp_ns)
        due = self._start[0] + (stamp_ns - self._start[1]) / self.speed
        return (due - now) / NS

    def passed(self, stamp_ns: int) -> float:
        """Notes that the source has come to a stamp, and returns the seconds until that is due, as `wait_s`."""
        wait = self.wait_s(stamp_ns)
        assert self._start is not None
        self._passed = (stamp_ns - self._start[1]) / self.speed / NS, max(-wait, 0.0)
        self.late_ms_max = max(self.late_ms_max, round(1e3 * self._passed[1]))
        return wait

    def restart(self) -> None:
        """Begins with a new origin, as time does with another episode; what was measured stays."""
        self._before = tuple(map(sum, zip(self._before, self._passed)))  # type: ignore[assignment]
        self._start, self._passed = None, (0.0, 0.0)

    def result(self) -> dict[str, float]:
        """Returns the speed that was wanted, the one that was reached, and late_ms_max, for a run's summary."""
        wanted, late = map(sum, zip(self._before, self._passed))
        reached = self.speed * wanted / (wanted + late) if late else self.speed
        return {"wanted": self.speed, "reached": round(reached, 6), "late_ms_max": self.late_ms_max}
