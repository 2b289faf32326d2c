"""Moves environments that were reset at different times, each in its own time since its reset.

Those that were reset together share an engine, whose stamps are round(j 1e9 / keyframe_rate) at the j-th keyframe since
then, as in a run of their own. As long as all of them began together at stamp 0 there is one engine, and what it gives
is passed on as it is.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from evis.runtime.clock import keyframe_stamp
from evis.scene.model import Scene
from msgs.own_time import CONFIGURED, NUMBER, ORIGIN, SEED, STAMP
from nodes.physics.actuators import check_controls
from nodes.physics.engines.engine import Engine, prepares
from nodes.physics.interval import Contacts, Interval

EACH_ONE = ("acceleration", "gravity")
"""What an environment has once in an interval, if it has it."""


@dataclass
class Group:
    """Holds environments that were reset together.

    envs: int [n], which they are. engine: of n environments. first: number of the keyframe at which its time is 0.
    live: bool [n], those of them that were not reset since. scene: what it moves, None = that of the run. interval:
    what the engine gave last.
    """

    envs: np.ndarray
    engine: Engine
    first: int
    live: np.ndarray
    scene: Scene | None = None
    interval: Interval | None = None


@dataclass(frozen=True)
class GroupState:
    """Holds a group as it was; engine: the state of its engine."""

    envs: np.ndarray
    engine: Any
    first: int
    live: np.ndarray
    scene: Scene | None
    interval: Interval


@dataclass(frozen=True)
class EnvironmentsState:
    """Holds where all environments were, as Environments has it."""

    groups: list[GroupState]
    seeds: np.ndarray
    configured: bool
    now: int


class Environments:
    """Moves E environments of a scene from keyframe to keyframe."""

    def __init__(self, engine: Engine, envs: int, keyframe_rate: float) -> None:
        """Begins with all environments in one group. engine: of E environments, at their start. keyframe_rate [Hz]."""
        self._envs, self._rate = envs, keyframe_rate
        self._actuators = engine.actuators
        self._groups = [Group(np.arange(envs), engine, 0, np.ones(envs, bool))]
        self._seeds = np.full(envs, CONFIGURED, np.int64)
        self._configured = True
        """Whether all have the seeds of the run."""
        self._now = 0

    @property
    def together(self) -> bool:
        """Tells whether all began together at stamp 0, with the seeds of the run."""
        return len(self._groups) == 1 and not self._groups[0].first and self._configured

    def advance(self, k: int, controls: np.ndarray | None = None, ahead: bool = False) -> Interval:
        """Gives the states up to keyframe k: the next one, or that at which environments begin.

        controls: float64 [E, nu], None = as before. Raises ValueError for others. ahead: whether the steps to the
        keyframe after it begin, while others work on this one; results of later calls are as if nothing had been begun.
        """
        before, self._now = self._now, k
        if controls is not None and len(self._groups) > 1:
            check_controls(controls, self._envs, self._actuators)
        going = [group for group in self._groups if k != group.first]
        stamps = [keyframe_stamp(k - group.first, self._rate) for group in going]
        for group, stamp in zip(going, stamps):
            if prepares(group.engine):
                own = None if controls is None else controls if self.together else controls[group.envs]
                group.engine.prepare(stamp, own)
        alone = len(self._groups) == 1 and bool(going)
        for group, stamp in zip(going, stamps):
            if ahead and alone and prepares(group.engine):
                following = keyframe_stamp(k + 1 - group.first, self._rate)
                group.interval = group.engine.advance(stamp, then_ns=following)
            else:
                group.interval = group.engine.advance(stamp)
        for group in self._groups:
            if k == group.first:
                group.interval = group.engine.start()
        if ahead and not alone:
            self._foresee(k + 1)
        return self._joined(keyframe_stamp(before, self._rate))

    def _foresee(self, k: int) -> None:
        """Begins the steps that lead to keyframe k, the next one, of all groups in one batch."""
        engines = [(group.engine, keyframe_stamp(k - group.first, self._rate)) for group in self._groups]
        ahead = [(engine, stamp) for engine, stamp in engines if prepares(engine)]
        for engine, stamp in ahead:
            engine.foresee(stamp)
        for engine, _stamp in ahead[:1]:
            engine.begin()

    def present(self) -> Interval:
        """Gives the states at the present keyframe once more, S = 1: after a reset at that very stamp."""
        for group in self._groups:
            if group.interval is None:
                group.interval = group.engine.start()
            group.interval = replace(group.interval, faults=[], warnings=[], again=0)
            group.interval.keep_last()
        return self._joined(keyframe_stamp(self._now, self._rate))

    def restart(
        self,
        envs: Sequence[int],
        seeds: Sequence[int],
        numbers: Sequence[int],
        k: int,
        engines: Sequence[tuple[list[int], Engine, Scene]] = (),
    ) -> None:
        """Begins environments anew at keyframe k, the present or the next one.

        seeds: of each, CONFIGURED = as before. numbers: how often each has begun anew with its seed, this time
        counted. engines: of those of them that do not move as before, at their start, and what they move.
        """
        parts: dict[int, list[int]] = {}
        for place, env in enumerate(envs):
            owner = next(n for n, g in enumerate(self._groups) if env in g.envs[g.live])
            parts.setdefault(owner, []).append(place)
        made: list[Group] = []
        others = {env for who, _, _ in engines for env in who}
        for owner, places in parts.items():
            group = self._groups[owner]
            for p in places:
                n = int(np.flatnonzero(group.envs == envs[p])[0])
                group.engine.leave(n)
                group.live[n] = False
            places = [p for p in places if envs[p] not in others]
            if not places:
                continue
            inner = [int(np.flatnonzero(group.envs == envs[p])[0]) for p in places]
            given = [None if seeds[p] == CONFIGURED else seeds[p] for p in places]
            engine = group.engine.anew(inner, given, [numbers[p] for p in places])
            made.append(Group(np.array([envs[p] for p in places]), engine, k, np.ones(len(places), bool), group.scene))
        made += [Group(np.array(who), engine, k, np.ones(len(who), bool), scene) for who, engine, scene in engines]
        self._groups = [group for group in self._groups if group.live.any()] + made
        for env, seed in zip(envs, seeds):
            if seed != CONFIGURED:
                self._seeds[env] = seed
        self._configured = bool((self._seeds == CONFIGURED).all())
        # Time goes back where all begin at stamp 0 again.
        self._now = min(self._now, k)

    def state(self) -> EnvironmentsState | None:
        """Gives where all environments are, as copies; None where an engine cannot tell."""
        groups = []
        for group in self._groups:
            engine, last = group.engine.state(), group.interval
            if engine is None or last is None:
                return None
            last = replace(last)
            last.keep_last()
            who, live = group.envs.copy(), group.live.copy()
            groups.append(GroupState(who, engine, group.first, live, group.scene, copy.deepcopy(last)))
        return EnvironmentsState(groups, self._seeds.copy(), self._configured, self._now)

    def restore(self, state: EnvironmentsState, make: Callable[[Scene, np.ndarray], Engine]) -> None:
        """Goes on from what `state` gave; this one was not moved yet.

        make: makes the engine of some environments int [n] of a scene that is not the run's.
        """
        own = self._groups[0].engine
        self._groups = []
        for kept in state.groups:
            if kept.scene is not None:
                engine = make(kept.scene, kept.envs)
            else:
                engine = own if len(kept.envs) == self._envs else own.part(kept.envs.tolist())
            engine.restore(kept.engine)
            last = copy.deepcopy(kept.interval)
            self._groups.append(Group(kept.envs.copy(), engine, kept.first, kept.live.copy(), kept.scene, last))
        self._seeds, self._configured, self._now = state.seeds.copy(), state.configured, state.now

    def own(self, numbers: np.ndarray) -> np.ndarray:
        """Gives the rows of msgs.own_time, int64 [E, 4]; numbers: int [E], of their resets."""
        rows = np.zeros((self._envs, 4), np.int64)
        for group in self._groups:
            mine = group.envs[group.live]
            rows[mine, STAMP] = keyframe_stamp(self._now - group.first, self._rate)
            rows[mine, ORIGIN] = keyframe_stamp(group.first, self._rate)
        rows[:, SEED], rows[:, NUMBER] = self._seeds, numbers
        return rows

    def _joined(self, previous: int) -> Interval:
        """Joins the intervals of all groups, from the stamp `previous` [ns]."""
        parts = [(group, group.interval) for group in self._groups if group.interval is not None]
        if self.together:
            return parts[0][1]
        steps = max(len(interval.t) for _, interval in parts)
        moving = np.unique(np.concatenate([interval.moving for _, interval in parts])).astype(np.int32)
        first = parts[0][1]
        bodies = first.end_pose.shape[1]
        shapes: dict[str, tuple[int, ...]] = {"end_pose": (bodies, 7)}
        shapes |= {"moving_pose": (steps, len(moving), 7), "moving_twist": (steps, len(moving), 6)}
        if first.qpos is not None and first.qvel is not None:
            shapes |= {"qpos": (steps, first.qpos.shape[-1]), "qvel": (steps, first.qvel.shape[-1])}
        for name in EACH_ONE:
            if (of_first := getattr(first, name)) is not None:
                shapes[name] = of_first.shape[1:]
        arrays = {name: np.zeros((self._envs, *shape)) for name, shape in shapes.items()}
        own_t = np.zeros((self._envs, steps), np.int64)
        for group, interval in parts:
            # Where there are fewer sub-steps, the first is repeated.
            rows = np.maximum(np.arange(steps) - (steps - len(interval.t)), 0)
            mine = group.envs[group.live]
            own_t[mine] = interval.t[rows]
            given = {
                "end_pose": interval.end_pose,
                "moving_pose": interval.pose[:, rows][:, :, moving],
                "moving_twist": interval.twist[:, rows][:, :, moving],
            }
            if interval.qpos is not None and interval.qvel is not None:
                given |= {"qpos": interval.qpos[:, rows], "qvel": interval.qvel[:, rows]}
            given |= {name: values for name in EACH_ONE if (values := getattr(interval, name)) is not None}
            for name, values in given.items():
                arrays[name][mine] = values[group.live]
        t = self._shared(parts, steps, previous)
        result = Interval(t, arrays["end_pose"], moving, arrays["moving_pose"], arrays["moving_twist"], own_t=own_t)
        result.lasting = True
        for name in ("qpos", "qvel", *EACH_ONE):
            setattr(result, name, arrays.get(name))
        result.contacts = self._contacts(parts)
        for group, interval in parts:
            result.again += interval.again
            kept = group.envs.tolist(), group.live.tolist()
            result.faults += [(kept[0][e], text) for e, text in interval.faults if kept[1][e]]
            result.warnings += [(kept[0][e], text) for e, text in interval.warnings if kept[1][e]]
        return result

    def _shared(self, parts: list[tuple[Group, Interval]], steps: int, previous: int) -> np.ndarray:
        """Gives the sub-step times [ns] of a group that has them all, on the clock of the stamps."""
        t = next(interval.t for _, interval in parts if len(interval.t) == steps)
        t = t - t[-1] + keyframe_stamp(self._now, self._rate)
        if steps > 1:
            # Own stamps are rounded otherwise.
            t[0] = min(previous, int(t[1]) - 1)
        return t

    @staticmethod
    def _contacts(parts: list[tuple[Group, Interval]]) -> Contacts | None:
        """Joins the contacts of all groups; None where nobody asked for them."""
        found = [(group, interval.contacts) for group, interval in parts if interval.contacts is not None]
        if len(found) < len(parts):
            return None
        return Contacts.joined([told.of(group.live) for group, told in found], [group.envs for group, _ in found])
