"""Paces messages: sources against the wall clock, and readers that take only some messages by their stamps."""

from __future__ import annotations

import time

from evis.runtime.clock import NS
from msgs.header import Header

FAST = 0.0
"""Speed of a source that waits for nobody's clock."""
FASTEST = 1e6
"""Largest speed of one that does: whoever wants more wants FAST."""


def parse_pace(text: str) -> float:
    """Parses a pace as a speed, seconds of stamps per second of the wall clock.

    `realtime` is 1, `fast` is FAST, and a number such as 2, 0.5 or 2x is itself. Raises ValueError.
    """
    named = {"realtime": 1.0, "fast": FAST}
    if text in named:
        return named[text]
    try:
        speed = float(text.removesuffix("x"))
    except ValueError:
        speed = -1.0
    if not 0 < speed <= FASTEST:
        raise ValueError(f"pace is '{text}', must be realtime, fast or a speed such as 2 or 0.5, at most {FASTEST:g}")
    return speed


class RateLimit:
    """Selects the messages of a topic for a reader that takes `rate_hz` of them a second in stamps and no more."""

    def __init__(self, rate_hz: float) -> None:
        self._period_ns = round(1e9 / rate_hz)
        self._due: tuple[int, int] | None = None

    def takes(self, header: Header) -> bool:
        """Tells whether this message is taken; to be called for all messages, in their order.

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
    """Delays a source so that stamps follow the wall clock, and measures how well they do.

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
        """Notes that the source has come to a stamp, and returns the seconds until that is due, as `wait_s` does."""
        wait = self.wait_s(stamp_ns)
        assert self._start is not None
        self._passed = (stamp_ns - self._start[1]) / self.speed / NS, max(-wait, 0.0)
        self.late_ms_max = max(self.late_ms_max, round(1e3 * self._passed[1]))
        return wait

    def restart(self) -> None:
        """Sets a new origin, as for an episode in which time starts anew; what was measured stays."""
        self._before = tuple(map(sum, zip(self._before, self._passed)))  # type: ignore[assignment]
        self._start, self._passed = None, (0.0, 0.0)

    def result(self) -> dict[str, float]:
        """Returns the wanted speed, the reached one, and late_ms_max, for a run's summary."""
        wanted, late = map(sum, zip(self._before, self._passed))
        reached = self.speed * wanted / (wanted + late) if late else self.speed
        return {"wanted": self.speed, "reached": round(reached, 6), "late_ms_max": self.late_ms_max}
