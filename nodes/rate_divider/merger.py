"""Merges consecutive world states into one over their whole interval, by pure functions of messages."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from msgs.header import Header
from msgs.world import WorldState

STEPS = ("moving_pose", "moving_twist", "qpos", "qvel")
"""Arrays [E, S, ...] with a row for each sub-step."""
CONTACTS = ("env", "body", "position", "normal", "force", "distance")
LAST = ("acceleration", "gravity", *(f"contact_{name}" for name in CONTACTS))
"""Those of the last stamp: what the last state has counts."""

Allocate = Callable[..., Mapping[str, np.ndarray]]
"""Arrays to write into, for name=(shape, dtype), ..."""


class Merger:
    """Joins each group of `count` states that follow one another to one.

    The first state of an episode is given out by itself, and the groups are counted from it. `gaps` counts states
    that did not begin where the one before had ended, within an episode; they start anew too. A group that is left
    unfinished has no stamp of its own and is dropped; `unfinished` counts its states. A state of the last one's stamp
    is of environments that begin anew there: they are at their start until the camera's next keyframe.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        self.gaps = self.unfinished = 0
        self._parts: list[WorldState] = []
        self._episodes = np.zeros(0, np.int32)
        """Those of the state given out last."""
        self._end: tuple[int, int] | None = None
        """Episode and stamp [ns] of the last state."""

    def push(self, state: WorldState, allocate: Allocate) -> WorldState | None:
        """Takes one state more; gives the merged one where that ends a group. `state` need not outlive the call."""
        now = (state.header.episode, state.header.stamp_ns)
        if now == self._end and self._parts:
            self._parts.append(_copy(state))
            return None
        follows = self._end == (state.header.episode, int(state.t[0])) and len(state.t) > 1
        all_begin = len(self._episodes) and bool((np.asarray(state.episodes) != self._episodes).all())
        later = self._end is not None and self._end[0] == now[0] and now[1] > self._end[1]
        if not follows and later and not all_begin:
            self.gaps += 1
        self._end = now
        if not follows:
            self.unfinished += self._intervals()
            self._parts = []
            return self._whole([state], allocate)
        if self._intervals() + 1 < self.count:
            self._parts.append(_copy(state))
            return None
        parts, self._parts = [*self._parts, state], []
        return self._whole(parts, allocate)

    def _intervals(self) -> int:
        """How many of the states that wait are of an interval."""
        return sum(len(part.t) > 1 for part in self._parts)

    def _whole(self, parts: Sequence[WorldState], allocate: Allocate) -> WorldState:
        episodes = np.array(parts[-1].episodes)
        begun = episodes != self._episodes if len(parts) > 1 else np.zeros(len(episodes), bool)
        self._episodes = episodes
        return merged(parts, begun, allocate)


def merged(parts: Sequence[WorldState], begun: np.ndarray, allocate: Allocate) -> WorldState:
    """Makes one state over the intervals of `parts`, each of which begins where the one before ends.

    The time where two meet stands once. What there is once in a state is the last one's. begun: bool
    [E], environments whose episode began within. They stand all along where they are at the end, for nothing may be
    interpolated across their restart.
    """
    last = parts[-1]
    moving = _moving(parts)
    given = {"t": np.concatenate([parts[0].t, *(part.t[1:] for part in parts[1:])]), "episodes": last.episodes}
    given |= {"end_pose": last.end_pose, "moving": moving}
    given |= {name: getattr(last, name) for name in LAST}
    if last.own is not None:
        given["own"] = last.own
    rows = dict(zip((*STEPS, "own_t"), zip(*(_steps(part, moving, skip=bool(i)) for i, part in enumerate(parts)))))
    if last.own_t is None:
        del rows["own_t"]
    rows = {name: pieces for name, pieces in rows.items() if pieces[-1] is not None}
    wanted: dict[str, tuple[tuple[int, ...], Any]] = {
        name: ((len(last.episodes), len(given["t"]), *pieces[0].shape[2:]), pieces[0].dtype)
        for name, pieces in rows.items()
    }
    wanted |= {name: (array.shape, array.dtype) for name, array in given.items() if array is not None}
    arrays = allocate(**wanted)
    for name, pieces in rows.items():
        np.concatenate(pieces, axis=1, out=arrays[name])
        arrays[name][begun] = arrays[name][begun, -1:]
    for name, array in given.items():
        if array is not None:
            arrays[name][...] = array
    header = Header(last.header.stamp_ns, clock=last.header.clock, episode=last.header.episode)
    return WorldState(header, names=list(last.names), **arrays)


def _moving(parts: Sequence[WorldState]) -> np.ndarray:
    """The bodies that move within any of the parts, int32 ascending, or stand elsewhere in one than in another."""
    end = parts[-1].end_pose
    moves = np.zeros(end.shape[1], bool)
    for part in parts:
        moves |= (part.end_pose != end).any(axis=(0, 2))
        moves[part.moving] = True
    return np.flatnonzero(moves).astype(np.int32)


def _steps(part: WorldState, moving: np.ndarray, skip: bool) -> tuple[Any, ...]:
    """The arrays of STEPS with a row for each of these bodies, the first sub-step left out where it is a repetition."""
    if np.array_equal(part.moving, moving):
        pose, twist = part.moving_pose, part.moving_twist
    else:
        pose, twist = part.rows(moving)
    own_t = part.own_t
    if own_t is None:
        # Environments share their time until one is reset by itself.
        own_t = np.broadcast_to(part.t, (len(part.end_pose), len(part.t)))
    found = (pose, twist, part.qpos, part.qvel, own_t)
    return tuple(None if array is None else array[:, int(skip) :] for array in found)


def _copy(state: WorldState) -> WorldState:
    """What a group needs of a state that is not its last."""
    names = ("t", "end_pose", "moving", "episodes", *STEPS, "own", "own_t")
    arrays: dict[str, Any] = {n: np.array(getattr(state, n)) for n in names if getattr(state, n) is not None}
    return WorldState(state.header, **arrays)
