"""Defines the interface of an interpolation method: keyframes and states in, frames and counts out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Protocol

import numpy as np
import warp as wp

from evis.runtime.clock import subframe_stamps

wp.config.log_level = wp.LOG_WARNING


@dataclass
class States:
    """Holds where the bodies are over the interval that ends with a keyframe.

    t: int64 [S] ns, ascending, from the keyframe before to this one. pose: float64 [E, S, B, 7]. twist: float64
    [E, S, B, 6], world frame. Both are of the bodies `moving`, int [B] ascending, and all others are at `rest`, float64
    [E, N, 7], the poses at t[-1], all along; without these two, of all N bodies. own_t: int64 [E, S] ns, not
    descending, where environments have times of their own, to be used in place of t.
    """

    t: np.ndarray
    pose: np.ndarray
    twist: np.ndarray
    moving: np.ndarray | None = None
    rest: np.ndarray | None = None
    own_t: np.ndarray | None = None

    def part(self, envs: np.ndarray) -> States:
        """Gives the states of these environments, int [n], which share their time."""
        rest = None if self.rest is None else self.rest[envs]
        if self.own_t is None:
            return States(self.t, self.pose[envs], self.twist[envs], self.moving, rest)
        t = self.own_t[envs[0]]
        steps = np.append(np.diff(t) > 0, True)
        return States(t[steps], self.pose[envs][:, steps], self.twist[envs][:, steps], self.moving, rest)

    def at(self, t: Sequence[int]) -> States:
        """Gives the same states at other times [ns]."""
        return replace(self, t=np.array(t, np.int64))

    @property
    def end_pose(self) -> np.ndarray:
        """Gives the poses of all bodies at the keyframe, float64 [E, N, 7]; not to be written to."""
        return np.asarray(self.pose[:, -1] if self.rest is None else self.rest, np.float64)

    def places(self, bodies: np.ndarray) -> np.ndarray:
        """Finds which bodies of `pose` and `twist` these of all are, int64, -1 for one that rests."""
        if self.rest is None or self.moving is None:
            return bodies
        place = np.full(self.rest.shape[1], -1)
        place[self.moving] = np.arange(len(self.moving))
        return place[bodies]


class StatesInARow(States):
    """Holds the states of gaps in a row, as of environments with times of their own."""

    def __init__(self, gaps: Sequence[States]) -> None:
        last = gaps[-1]
        super().__init__(last.t, last.pose, last.twist, last.moving, np.concatenate([s.end_pose for s in gaps]))
        self._gaps = gaps

    def part(self, envs: np.ndarray) -> States:
        """Gives the states of a gap, int [1]."""
        (gap,) = envs
        return self._gaps[gap]


@dataclass
class KeyframeView:
    """Holds one keyframe of E environments, margin included, as a method sees it.

    image: float32 [E, H, W] luminance or [E, H, W, 3] linear RGB. depth: float32 [E, H, W] m, +inf = sky. motion:
    float32 [E, H, W, 2] px, backward. stamp_ns: its time. What a method does not use is None.

    own: int64 [E] ns, its time in each environment, where these have times of their own. replaces: the view at the same
    stamp in whose place it comes, for some environments began anew there: those of `begun`, bool [E].

    Of gaps in a row, as environments whose times differ, the A are `after` the B of the gaps before: the first A is the
    last of these.
    """

    image: wp.array
    depth: wp.array | None = None
    motion: wp.array | None = None
    states: States | None = None
    stamp_ns: int = 0
    own: np.ndarray | None = None
    replaces: KeyframeView | None = None
    begun: np.ndarray | None = None
    after: KeyframeView | None = None

    def times(self, envs: int) -> np.ndarray:
        """Gives its time in each environment, int64 [E] ns."""
        return np.full(envs, self.stamp_ns) if self.own is None else self.own


def own_subframes(starts: np.ndarray, ends: np.ndarray, held: np.ndarray, upsampling: int) -> np.ndarray:
    """Computes the times int64 [E, K] ns of the frames of gaps from `starts` to `ends` [E] ns in environments with
    times of their own; all of them are the end where one is held."""
    times = np.repeat(ends[:, None], upsampling, axis=1)
    for e in np.flatnonzero(~held).tolist():
        times[e] = subframe_stamps(int(starts[e]), int(ends[e]), upsampling)
    return times


@dataclass(frozen=True)
class Span:
    """Holds when a gap is and the states to its ends, without any image.

    starts, ends: int64 [E] ns. a, b: states to the keyframes. held: bool [E], environments that have no gap. apart:
    whether environments have times of their own.
    """

    starts: np.ndarray
    ends: np.ndarray
    a: States
    b: States
    held: np.ndarray
    apart: bool

    @classmethod
    def between(cls, a: KeyframeView, b: KeyframeView, held: np.ndarray) -> Span:
        """Makes the span between two keyframes, which have states."""
        assert a.states is not None and b.states is not None
        apart = a.own is not None or b.own is not None
        return cls(a.times(len(held)), b.times(len(held)), a.states, b.states, held, apart)

    @property
    def longest(self) -> int:
        """Gives the length of the longest gap of an environment that has one [ns], 0 without any."""
        return int((self.ends - self.starts)[~self.held].max(initial=0))

    def stamps(self, count: int) -> np.ndarray:
        """Gives the times of its end and of count - 1 instants before, evenly apart: int64 [count] ns, or [E, count]
        where environments have times of their own."""
        if self.apart:
            return own_subframes(self.starts, self.ends, self.held, count)
        return subframe_stamps(int(self.starts[0]), int(self.ends[0]), count)

    def same(self, other: Span) -> bool:
        """Tells whether the other one is of the same gap, and its states the very same objects."""
        alike = self.a is other.a and self.b is other.b and self.apart == other.apart
        mine, theirs = ((span.starts, span.ends, span.held) for span in (self, other))
        return alike and all(np.array_equal(m, t) for m, t in zip(mine, theirs))


@dataclass
class Report:
    """Counts pixels of the sub-frames of one gap, the last one left out.

    filled: seen by no keyframe and guessed from a neighbour. nonfinite: sources dropped because their motion or their
    radiance is not finite. reshaded: shaded anew at their own time. samples: all pixels of the sub-frames that were
    made. sampled: those of them that `rigid` looked up or shaded, the others being as in the later keyframe or between
    two that it did; on a GPU without such, all. refined: further samples of single pixels between the frames.
    unreached: in how many environments these are not as close as the tolerance of time asks for. unseen: in how many
    things are so fast that some of them passes pixels between two looks at them.
    """

    filled: int = 0
    nonfinite: int = 0
    reshaded: int = 0
    samples: int = 0
    sampled: int = 0
    refined: int = 0
    unreached: int = 0
    unseen: int = 0

    def __add__(self, other: Report) -> Report:
        """Adds up the counts of two gaps."""
        return Report(*(getattr(self, item.name) + getattr(other, item.name) for item in fields(Report)))


class Method(Protocol):
    """Makes the frames of the gap between two keyframes."""

    def between(
        self, a: KeyframeView, b: KeyframeView, held: Sequence[bool] | np.ndarray, out: np.ndarray | wp.array
    ) -> Report:
        """Writes frames i = 1 .. K of the gap into out, float32 [E, K, h, w(, 3)] without margin; the last is b itself.

        out: numpy, or an array of the method's device.

        held: bool [E], environments that begin a new episode with b; all their frames are b.
        """


def check_follows(before_ns: int, after_ns: int) -> None:
    """Raises ValueError where a keyframe is not later than the one before it, in the same episode."""
    if after_ns <= before_ns:
        raise ValueError(f"keyframe at {after_ns} ns came after the one at {before_ns} ns of the same episode")
