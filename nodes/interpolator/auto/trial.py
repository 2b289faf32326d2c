"""Runs the second stage of the probe: candidates whose cost decides the choice are run in full for some gaps.

What the first stage predicts is put together from parts, each measured by itself, while in a run they take caches from
each other; it can be off by some ten percent. That matters only where another choice would be made if a cost were a
little lower or higher. Such ways are run in full, renderer, interpolator and sensor in turn, for some gaps of the scene
itself, until no other choice is left that a doubt about a cost could lead to, or the time is up. What one trial takes
beside its prediction corrects the others of its method, and doubts about those near it are small.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from nodes.interpolator.auto.chain import Chain
from nodes.interpolator.auto.choice import ONE_RATE, Candidate, Choice, choose
from nodes.interpolator.auto.setting import Setting, Way

ALLOWED_S = 2.5
"""Time for all trials of a choice [s]."""
DOUBTS = {False: (0.3, 0.12, 0.05), True: (0.9, 0.5, 0.2)}
"""By how much a prediction may be off, on a CPU and on a GPU, where stages overlap: one that nothing corrects, one that
a trial of its method corrects, and one that a trial at the same keyframe rate and about the same K does (of dense
rendering, at about the same rate)."""
NEAR = 2.0
"""Ratio of frames per second up to which two ways are near each other."""


@dataclass(frozen=True)
class Trial:
    """Holds the run time of a way that was run [s per simulated s], physics and all environments included."""

    method: str
    keyframe_rate: float
    upsampling: int
    seconds: float


@dataclass
class Measured:
    """Holds what is known of a setting: candidates as predicted, the physics engine's share [s per simulated s], and
    trials so far."""

    candidates: list[Candidate]
    moving: float = 0.0
    trials: list[Trial] = field(default_factory=list)

    def as_json(self) -> dict[str, Any]:
        """Converts to a dictionary of plain types."""
        return asdict(self)

    @staticmethod
    def of_json(found: dict[str, Any]) -> Measured:
        """Converts back from `as_json`. Raises TypeError or KeyError for anything else."""
        candidates, trials = ([kind(**row) for row in found[name]] for kind, name in KINDS)
        return Measured(candidates, float(found["moving"]), trials)


KINDS: tuple[tuple[Any, str], ...] = ((Candidate, "candidates"), (Trial, "trials"))


def way_of(given: Candidate | Trial) -> Way:
    """Gives method, keyframe rate [Hz] and K of a candidate or trial."""
    return given.method, given.keyframe_rate, given.upsampling


def near(a: Way, b: Way) -> bool:
    """Tells whether a trial of one candidate predicts the cost of the other to a few percent."""
    more = max(a[1] * a[2], b[1] * b[2]) / min(a[1] * a[2], b[1] * b[2])
    return a[0] == b[0] and (a[0] == "none" or a[1] == b[1]) and more <= NEAR * ONE_RATE


def believed(
    candidates: Sequence[Candidate], trials: Sequence[Trial], on_gpu: bool = False
) -> list[tuple[Candidate, float]]:
    """Corrects the cost of candidates by trials; gives each with the share by which its cost may be off, 0 if run.

    The prediction of what was not run is corrected as those were that are most like it: at the same keyframe rate and
    about the same K, of the same method, or all.
    """
    unknown, of_method, close_by = DOUBTS[on_gpu]
    by_way = {way_of(c): c.seconds for c in candidates}
    run = {way_of(t): t.seconds for t in trials if way_of(t) in by_way}
    result = []
    for c in candidates:
        own = way_of(c)
        if own in run:
            result.append((replace(c, seconds=run[own]), 0.0))
            continue
        close = [way for way in run if near(way, own)]
        alike = close or [way for way in run if way[0] == c.method]
        logs = [math.log(run[way] / by_way[way]) for way in alike or run]
        factor = math.exp(sum(logs) / len(logs)) if logs else 1.0
        doubt = close_by if close else of_method if alike else unknown
        result.append((replace(c, seconds=round(c.seconds * factor, 6)), doubt))
    return result


def in_doubt(known: Sequence[tuple[Candidate, float]], rule: Callable[[list[Candidate]], Choice]) -> list[Candidate]:
    """Finds the candidates on whose cost the choice depends, the most in doubt first.

    These are the one chosen, if it would not be chosen at the highest cost that it may have, and those that would be
    chosen at their lowest."""
    costs = [c for c, _ in known]
    best = rule(costs).candidate
    found: list[tuple[float, int]] = []
    for n, (c, doubt) in enumerate(known):
        if not doubt:
            continue
        chosen = c is best
        other = replace(c, seconds=c.seconds * (1 + doubt) if chosen else c.seconds / (1 + doubt))
        then = rule([*costs[:n], other, *costs[n + 1 :]]).candidate
        if (then is other) != chosen:
            # The one chosen goes first.
            found.append((doubt + chosen, n))
    return [costs[n] for _, n in sorted(found, key=lambda pair: (-pair[0], costs[pair[1]].error))]


def settle(
    setting: Setting,
    measured: Measured,
    wanted_error: float | None = None,
    wanted_rtf: float | None = None,
    say: Callable[[str], None] = lambda line: None,
) -> Choice:
    """Chooses a candidate, after trials of those that the choice depends on.

    Args:
        setting: how the scene is run.
        measured: candidates of the probe; trials are added to it.
        wanted_error, wanted_rtf: the user's wishes, see `choice`.
        say: called with what is being done.
    """

    def rule(candidates: list[Candidate]) -> Choice:
        return choose(candidates, wanted_error, wanted_rtf)

    chain = Chain(setting)
    left, given_up = ALLOWED_S, set()
    while True:
        known = believed(measured.candidates, measured.trials, setting.on_gpu)
        open_ = [c for c in in_doubt(known, rule) if way_of(c) not in given_up]
        if not open_ or left <= 0:
            return rule([c for c, _ in known])
        c = open_[0]
        way, own = way_of(c), c.seconds - measured.moving
        if not chain.gaps(way, own) or chain.takes(way, own) > left:
            given_up.add(way)
            continue
        say(f"trial of {c}")
        began = setting.clock()
        seconds = measured.moving + chain.seconds(way, own)
        left -= setting.clock() - began
        measured.trials.append(Trial(*way, round(seconds, 6)))
