"""Describes the motion of environments between two stamps, put together from their states after each step.

Steps lie on a grid of their own: an interval begins and ends between two of its points, where states are interpolated.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from msgs.world import EVERY
from nodes.physics.dynamics.assembly import Assembly
from nodes.physics.dynamics.batch.stepped_states import JOINTS
from nodes.physics.dynamics.course.paths import PathsByShape
from nodes.physics.dynamics.course.poses_between import PosesBetween
from nodes.physics.dynamics.states import State, joints_between
from nodes.physics.interval import Interval, grid_inside
from nodes.physics.room import check_room

PART = 1 << 17
"""Numbers of environments' poses that are worked on at once: of fewer calls take longer than what they do, and with
more some cores have nothing to do."""


@dataclass(frozen=True)
class CourseState:
    """Holds where a course is, as Course has it."""

    stamp: int
    grid: int
    before: State
    now: State
    last: State


class Course:
    """Makes the intervals of E environments, one after the other.

    now, before: states at the last grid point and at the one before. last: states at the stamp of the last interval's
    end, where the next one begins.
    """

    def __init__(
        self, assembly: Assembly, model: Any, step_ns: int, joints: bool, ends: bool, pool: ThreadPoolExecutor | None
    ) -> None:
        """Takes an assembly and its model. joints: whether intervals have the positions and velocities of the joints.
        ends: whether `last` has them. pool: threads that share environments."""
        self._assembly, self._model, self._step_ns, self._joints = assembly, model, step_ns, joints
        self._ends_of_joints, self._pool, self._paths = joints or ends, pool, PathsByShape()

    def anew(self) -> Course:
        """Makes the course of other environments of the model."""
        return copy.copy(self)

    def begin(self, state: State) -> None:
        """Begins at stamp 0 in this state."""
        self.stamp = self.grid = 0
        two = {name: np.repeat(value[:, None], 2, axis=1) for name, value in state.items()}
        self.before, self.now = ({name: value[:, k] for name, value in two.items()} for k in (0, 1))
        self.last = {name: value.copy() for name, value in state.items()}
        self._poses_between = PosesBetween(two["pose"], two["twist"], self.last["pose"])

    def state(self) -> CourseState:
        """Gives where the course is between two intervals, as copies."""
        ends = ({name: value.copy() for name, value in state.items()} for state in (self.before, self.now, self.last))
        return CourseState(self.stamp, self.grid, *ends)

    def restore(self, state: CourseState) -> None:
        """Goes on from what `state` gave."""
        self.begin(state.now)
        self.stamp, self.grid = state.stamp, state.grid
        # In place: kernels know these arrays.
        for own, kept in ((self.before, state.before), (self.last, state.last)):
            for name, value in kept.items():
                own[name][:] = value

    def start(self) -> Interval:
        """Gives the state at stamp 0, S = 1."""
        pose, twist = (self.now[name][:, None] for name in ("pose", "twist"))
        interval = self._assembly.interval(np.zeros(1, np.int64), pose, twist)
        if self._joints:
            interval.qpos, interval.qvel = (self.now[name][:, None] for name in JOINTS)
        return interval

    def open(self, to_ns: int) -> range:
        """Begins the interval up to stamp `to_ns` [ns]; gives the times [ns] from which steps are to be taken.

        Raises ValueError where its states do not fit into memory.
        """
        steps = range(self.grid, to_ns, self._step_ns)
        check_room(to_ns - self.stamp, len(steps), len(self._assembly.may_move), len(self.now["pose"]))
        self._to, self._steps = to_ns, len(steps)
        # A grid point at the interval's start is left out.
        at_start = bool(steps) and self.grid <= self.stamp
        inside = len(steps) - at_start
        self.first = 1 + inside - max(len(steps) - 1, 0)
        self._t = np.empty(inside + 2, np.int64)
        self._t[0], self._t[-1] = self.stamp, to_ns
        self._t[1:-1] = np.arange(inside) * self._step_ns + (self.grid + at_start * self._step_ns)
        ends = self.grid + len(steps) * self._step_ns
        self._ends = np.array([ends - self._step_ns, ends])
        shape = len(self.now["pose"]), len(self._t), len(self._assembly.may_move)
        self.paths = self._paths.of(shape)
        """Of the bodies that may move."""
        self.poses, self.twists = self.paths.poses, self.paths.twists
        self._assembly.put_paths(self._t, self.poses, self.twists)
        own, columns = self._assembly.own
        self.poses[:, 0, own], self.twists[:, 0, own] = (self.last[n][:, columns] for n in ("pose", "twist"))
        if self.first == 2:
            self.poses[:, 1, own], self.twists[:, 1, own] = (self.now[n][:, columns] for n in ("pose", "twist"))
        self.fastest = np.zeros(shape[0])
        """The largest component of a velocity of a body that MuJoCo moves, of each environment."""
        self.of_joints = {name: np.empty((*shape[:2], self.now[name].shape[1])) for name in JOINTS if self._joints}
        for name, values in self.of_joints.items():
            values[:, 0] = self.last[name]
            if self.first == 2:
                values[:, 1] = self.now[name]
        return steps

    def write(self, envs: np.ndarray, states: State) -> None:
        """Takes the states [m, steps, ...] after each step of m environments."""
        own, columns = self._assembly.own
        inner = slice(self.first, self.first + self._steps - 1)
        for values, name in ((self.poses, "pose"), (self.twists, "twist")):
            values[np.ix_(envs, np.arange(*inner.indices(len(self._t))), own)] = states[name][:, :-1, columns]
        for name, values in self.of_joints.items():
            values[envs, inner] = states[name][:, :-1]
        self.fastest[envs] = np.abs(states["twist"][:, :-1]).max(axis=(1, 2, 3), initial=0.0)
        self.stepped(envs, {name: value[:, -2:] for name, value in states.items()})

    def stepped(self, envs: np.ndarray | slice, last_two: State) -> None:
        """Takes the states [m, 2, ...] of m environments after the last two steps, or after the only one, twice."""
        for name, values in last_two.items():
            self.before[name][envs] = values[:, 0] if self._steps > 1 else self.now[name][envs]
            self.now[name][envs] = values[:, -1]

    def hold(self, envs: Sequence[int]) -> None:
        """Keeps environments in their present states for the whole interval."""
        if len(envs):
            chosen = np.array(envs)
            now = {name: value[chosen][:, None] for name, value in self.now.items()}
            self.write(chosen, {name: np.repeat(value, self._steps, axis=1) for name, value in now.items()})

    def restart(self, env: int, state: State) -> None:
        """Puts an environment to a state [1, ...], as if it had been there all along the interval."""
        own, columns = self._assembly.own
        for name, value in state.items():
            self.before[name][env] = self.now[name][env] = self.last[name][env] = value[0]
        self.poses[env][:, own], self.twists[env][:, own] = (state[n][0, columns] for n in ("pose", "twist"))
        for name, values in self.of_joints.items():
            values[env] = state[name][0]
        self.fastest[env] = np.abs(state["twist"]).max(initial=0.0)

    @property
    def next_grid(self) -> int:
        """Gives the time [ns] of the grid point up to which the open interval's steps go."""
        return self.grid + self._steps * self._step_ns

    def close(self) -> Interval:
        """Gives the interval, of which all environments were written."""
        envs = len(self.poses)
        size = max(1, PART // max(self.poses[0].size, 1))
        parts: list[slice | None] = [slice(e, e + size) for e in range(0, envs, size)] if envs > size else [None]
        each = map if self._pool is None or len(parts) == 1 else self._pool.map
        if self._to != self._ends[1]:
            self._poses_between.aim(self._to, self._ends)
        moved = np.logical_or.reduce([*each(self._finish, parts)])
        self.stamp, self.grid = self._to, self.next_grid
        poses, twists = self.poses, self.twists
        if len(parts) > 1 and 2 * moved.sum() > len(moved):
            # To leave out a few of many would copy all others.
            moved[:] = True
        ends = self._assembly.end_poses(poses[:, -1], self.now["pose"])
        if not moved.all():
            poses, twists = poses[:, :, moved], twists[:, :, moved]
        elif self.paths.kept:
            poses, twists = poses.copy(), twists.copy()
        result = Interval(self._t, ends, self._assembly.may_move[moved], poses, twists, lasting=True)
        if self._joints:
            result.qpos, result.qvel = (self.of_joints[name] for name in JOINTS)
        del self.poses, self.twists, self.paths, self.of_joints
        return result

    def _finish(self, part: slice | None) -> np.ndarray:
        """Writes the end of the interval, and what is mounted on other bodies, of some environments, None = of all.

        Returns which bodies move, bool [M].
        """
        envs = part or EVERY
        before, now, last = ({n: v[envs] for n, v in state.items()} for state in (self.before, self.now, self.last))
        poses, twists = self.poses[envs], self.twists[envs]
        if self._to == self._ends[1]:
            for name, value in now.items():
                last[name][:] = value
        else:
            # Velocities lie on a straight line. The derivative of the poses' cubic would not do: most integrators move
            # a body by the velocity after the step, p1 = p0 + h v1, and it overshoots v1 then.
            u = (self._to - self._ends[0]) / (self._ends[1] - self._ends[0])
            self._poses_between.write(part)
            last["twist"][:] = (1 - u) * before["twist"] + u * now["twist"]
            joints = joints_between(self._model, before, now, u) if self._ends_of_joints else {}
            for name, value in joints.items():
                last[name][:] = value
        own, columns = self._assembly.own
        poses[:, -1, own], twists[:, -1, own] = (last[n][:, columns] for n in ("pose", "twist"))
        for name, values in self.of_joints.items():
            values[envs, -1] = last[name]
        at_ends = [np.abs(state["twist"]).max(axis=(1, 2), initial=0.0) for state in (last, now)]
        self.fastest[envs] = np.maximum(self.fastest[envs], np.maximum(*at_ends))
        self._assembly.put_mounted(self.paths, part)
        return self.paths.moving(part)

    def rest(self, to_ns: int) -> Interval:
        """Goes on to a stamp without a step: all bodies of MuJoCo stay where they are."""
        inner = grid_inside(self.stamp, to_ns, self._step_ns) if self._assembly.moves else ()
        times = np.array([self.stamp, *inner, to_ns], np.int64)
        self.grid += -(-max(to_ns - self.grid, 0) // self._step_ns) * self._step_ns
        self.stamp = to_ns
        names = ("pose", "twist", *(JOINTS if self._joints else ()))
        course = {name: np.repeat(self.last[name][:, None], len(times), axis=1) for name in names}
        result = self._assembly.interval(times, course["pose"], course["twist"], still=True)
        if self._joints:
            result.qpos, result.qvel = (course[name] for name in JOINTS)
        return result

    def put_to_rest(self, envs: Sequence[int]) -> None:
        """Sets environments to rest in the state at their last grid point."""
        chosen = list(envs)
        self.now["twist"][chosen] = 0.0
        for name, value in self.now.items():
            self.before[name][chosen] = self.last[name][chosen] = value[chosen]
