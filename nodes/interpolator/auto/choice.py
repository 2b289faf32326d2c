"""Chooses method, keyframe rate and K for `auto`, from what each was found to cost and how far off its events are.

The rule, over all candidates that the user's own keyframe rate and K leave:

- with a wanted error, the cheapest one that keeps it; with a wanted real-time factor, the one with the least error
  that keeps that; with both, the cheapest that keeps both;
- with neither, the cheapest one whose error is at most SLACK times the least that BASE_RATE frames per second reach;
- where nothing keeps what is wanted, the one that comes nearest to it, which `met` and `why` say; of two wishes the
  real-time factor counts first.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

BASE_RATE = 1000.0
"""Frames per second that a run is measured against when nothing else is wanted [Hz]."""
SLACK = 1.2
"""Error over the least one up to which the cheaper candidate is taken."""
COARSE_HZ = 250.0
"""Frames per second, about, beside which single pixels are evaluated between the frames.

Fewer save no time, for more is left to evaluate, and have more error (`evis bench between`): at 31 keyframes per second
x 4, x 8 and x 16 the drone has 0.063, 0.053 and 0.041 in 112, 95 and 122 ms a gap, the warehouse 0.043, 0.038 and 0.032
in 182, 221 and 317 ms."""
LOOSE_S = 2e-4
"""Error of time from which on half as many will do [s]: with 0.3 ms, x 4 and x 8, at 173x130, the warehouse has 0.066
and 0.061 in 269 and 319 ms."""
ONE_RATE = 1.001
"""Frames per second within this factor of each other are one rate: keyframe rates are rounded."""
EVEN = 1.02
"""Errors and costs within this factor of each other are the same: measurements do not tell them apart."""


@dataclass(frozen=True)
class Candidate:
    """Holds one way to run a scene, and the error and cost that were found for it.

    error: of the events, spike-train distance to dense rendering (0 ... 1). seconds: run time per simulated second.
    """

    method: str
    keyframe_rate: float
    upsampling: int
    error: float
    seconds: float

    @property
    def frame_rate(self) -> float:
        """Gives the frames per second that the sensor sees [Hz]."""
        return self.keyframe_rate * self.upsampling

    def __str__(self) -> str:
        return f"{self.method}, {self.keyframe_rate:g} keyframes per second x {self.upsampling}"


@dataclass(frozen=True)
class Choice:
    """Holds what was chosen, the reason in one line, and whether the user's wishes are kept."""

    candidate: Candidate
    why: str
    met: bool = True


def frames_beside_samples(keyframe_rate: float, time_tolerance: float) -> int:
    """Chooses K for a run that evaluates single pixels between its frames. keyframe_rate [Hz], time_tolerance [s]."""
    rate = COARSE_HZ if time_tolerance < LOOSE_S else COARSE_HZ / 2
    return max(2, round(rate / keyframe_rate))


def with_steps_between(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Adds three candidates between every two of one method whose K (of dense rendering: whose rate) differs twofold;
    their cost is linear in the frame rate, their error a power of it."""
    found = list(candidates)
    for low in candidates:
        for high in candidates:
            twice = abs(high.frame_rate / low.frame_rate - 2) < 1e-6
            alike = low.keyframe_rate == high.keyframe_rate or low.upsampling == high.upsampling == 1
            if low.method != high.method or not twice or not alike:
                continue
            for step in (1.25, 1.5, 1.75):
                if low.upsampling == high.upsampling:
                    rate, k = low.keyframe_rate * step, 1
                else:
                    rate, k = low.keyframe_rate, round(low.upsampling * step)
                if k in (low.upsampling, high.upsampling) and k > 1:
                    continue
                part = math.log2(rate * k / low.frame_rate)
                error = low.error ** (1 - part) * high.error**part
                cost = low.seconds + (high.seconds - low.seconds) * (rate * k / low.frame_rate - 1)
                found.append(Candidate(low.method, rate, k, round(error, 6), round(cost, 6)))
    return found


def choose(
    candidates: Sequence[Candidate], wanted_error: float | None = None, wanted_rtf: float | None = None
) -> Choice:
    """Chooses the best candidate by the rule that the module states. Raises ValueError where there are none."""
    if not candidates:
        raise ValueError("interpolator auto has nothing to choose from: no keyframe rate and K fit the run")
    for name, value in (("wanted_error", wanted_error), ("wanted_rtf", wanted_rtf)):
        if value is not None and not value > 0:
            raise ValueError(f"{name} is {value:g}, it must be more than 0")
    if wanted_error is None and wanted_rtf is None:
        return _by_slack(candidates)
    fast = [c for c in candidates if wanted_rtf is None or c.seconds * wanted_rtf <= 1]
    exact = [c for c in fast if wanted_error is None or c.error <= wanted_error]
    if not fast:
        best = _least(candidates, _cost, _error)
        return Choice(best, f"nothing found reaches a real-time factor of {wanted_rtf:g}: the fastest", False)
    if wanted_error is None:
        best = _least(fast, _error, _cost)
        return Choice(best, f"the least error at a real-time factor of {wanted_rtf:g} or more")
    within = f" at a real-time factor of {wanted_rtf:g} or more" if wanted_rtf is not None else ""
    if not exact:
        best = _least(fast, _error, _cost)
        return Choice(best, f"nothing found has an error of {wanted_error:g} or less{within}: the least", False)
    return Choice(_least(exact, _cost, _error), f"the cheapest with an error of {wanted_error:g} or less{within}")


def _by_slack(candidates: Sequence[Candidate]) -> Choice:
    base = [c for c in candidates if c.frame_rate <= ONE_RATE * BASE_RATE] or list(candidates)
    least = min(c.error for c in base)
    best = _least([c for c in candidates if c.error <= SLACK * least], _cost, _error)
    if not least:
        return Choice(best, "the cheapest without error")
    rates = [c.frame_rate for c in base]
    limit = "" if max(rates) < ONE_RATE * min(rates) else "up to "
    return Choice(
        best,
        f"the cheapest with an error of at most {SLACK:g} times {least:.3g}, "
        f"the least found at {limit}{max(rates):g} frames per second",
    )


def _cost(candidate: Candidate) -> float:
    return candidate.seconds


def _error(candidate: Candidate) -> float:
    return candidate.error


def _least(
    candidates: Sequence[Candidate], first: Callable[[Candidate], float], then: Callable[[Candidate], float]
) -> Candidate:
    """Finds the least by `first`; those within a factor of EVEN count as equal, and are compared by `then`, at last by
    keyframe rate and method."""
    bound = min(first(c) for c in candidates) * EVEN
    return min((c for c in candidates if first(c) <= bound), key=lambda c: (then(c), c.keyframe_rate, c.method))
