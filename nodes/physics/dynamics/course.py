"""The course of environments between two stamps, put together from their states after each step.

Steps lie on a grid of their own: an interval begins and ends between two of its points, where states are interpolated.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np

from msgs.world import moves
from nodes.physics.dynamics.assembly import Assembly
from nodes.physics.dynamics.states import State, between
from nodes.physics.interval import Interval, grid_inside

JOINTS = ("qpos", "qvel")


class Course:
    """Makes the intervals of E environments, one after the other.

    now, before: states at the last grid point and at the one before. last: states at the stamp of the last interval's
    end, where the next one begins. Environments are written by any number of threads, each by one.
    """

    def __init__(self, assembly: Assembly, model: Any, step_ns: int, joints: bool) -> None:
        """joints: whether intervals have the positions and velocities of the joints."""
        self._assembly, self._model, self._step_ns, self._joints = assembly, model, step_ns, joints

    def anew(self) -> Course:
        """Makes the course of other environments of the model."""
        return copy.copy(self)

    def begin(self, state: State) -> None:
        """Begins at stamp 0 in this state."""
        self.stamp = self.grid = 0
        self.before, self.now, self.last = ({name: value.copy() for name, value in state.items()} for _ in range(3))

    def start(self) -> Interval:
        """Gives the state at stamp 0, S = 1."""
        pose, twist = (self.now[name][:, None] for name in ("pose", "twist"))
        interval = self._assembly.interval(np.zeros(1, np.int64), pose, twist)
        if self._joints:
            interval.qpos, interval.qvel = (self.now[name][:, None] for name in JOINTS)
        return interval

    def open(self, to_ns: int) -> range:
        """Begins the interval up to stamp `to_ns` [ns]; gives the times [ns] from which steps are to be taken."""
        steps = range(self.grid, to_ns, self._step_ns)
        inside = [t for t in steps if t > self.stamp]
        self._first_inside = len(steps) - len(inside)
        self._to, self._steps = to_ns, len(steps)
        self._t = np.array([self.stamp, *inside, to_ns], np.int64)
        self._ends = np.array([steps[-1], steps[-1] + self._step_ns] if len(steps) else self._ends_before())
        self._prescribed = self._assembly.prescribed(self._t)
        may_move, envs = self._assembly.may_move, len(self.now["pose"])
        shape = envs, len(self._t), len(may_move)
        self._poses, self._twists = np.empty((*shape, 7)), np.empty((*shape, 6))
        self._end_poses = np.empty((envs, self._assembly.bodies, 7))
        self._moves = np.zeros(len(may_move), bool)
        self.fastest = np.zeros(envs)
        """The largest component of a velocity of a body that MuJoCo moves, of each environment."""
        self._of_joints = (
            {name: np.empty((envs, len(self._t), self.now[name].shape[1])) for name in JOINTS} if self._joints else {}
        )
        return steps

    def _ends_before(self) -> list[int]:
        return [self.grid - self._step_ns, self.grid]

    def write(self, envs: np.ndarray | slice, states: State) -> None:
        """Takes the states [m, steps, ...] after each step of m environments."""
        wanted = ("pose", "twist", *self._of_joints)
        inside = {name: self._inside(self.now[name][envs], states[name]) for name in wanted} if self._steps else {}
        if self._steps:
            for name, value in states.items():
                self.before[name][envs] = value[:, -2] if self._steps > 1 else self.now[name][envs]
                self.now[name][envs] = value[:, -1]
        end = self._end(envs)
        course = {
            name: np.concatenate([self.last[name][envs][:, None], *inside.get(name, ()), end[name][:, None]], axis=1)
            for name in wanted
        }
        for name, value in end.items():
            self.last[name][envs] = value
        for name, values in self._of_joints.items():
            values[envs] = course[name]
        self._assemble(envs, course["pose"], course["twist"])

    def _inside(self, start: np.ndarray, after: np.ndarray) -> list[np.ndarray]:
        """The states at the grid points inside the interval: before the first step, if it is one, and after others."""
        return [*[start[:, None].copy()] * (self._first_inside == 0), after[:, : self._steps - 1]]

    def _end(self, envs: np.ndarray | slice) -> State:
        """The state at the end of the interval, between the last two grid points."""
        before, now = ({name: value[envs] for name, value in state.items()} for state in (self.before, self.now))
        if self._to == self._ends[1]:
            return {name: value.copy() for name, value in now.items()}
        return between(self._model, before, now, self._ends, self._to)

    def _assemble(self, envs: np.ndarray | slice, pose: np.ndarray, twist: np.ndarray) -> None:
        self.fastest[envs] = np.abs(twist).max(axis=(1, 2, 3), initial=0.0)
        poses, twists = self._assembly.whole(self._prescribed, pose, twist)
        may_move = self._assembly.may_move
        self._end_poses[envs] = poses[:, -1]
        if len(may_move) < self._assembly.bodies:
            poses, twists = poses[:, :, may_move], twists[:, :, may_move]
        self._poses[envs], self._twists[envs] = poses, twists
        # Other threads do so too, and none takes anything back.
        unknown = np.flatnonzero(~self._moves)
        if len(unknown):
            self._moves[unknown[moves(poses[:, :, unknown], twists[:, :, unknown])]] = True

    def stay(self, envs: Sequence[int]) -> None:
        """Leaves environments in their present states."""
        if len(envs):
            chosen = np.array(envs)
            now = {name: value[chosen][:, None] for name, value in self.now.items()}
            self.write(chosen, {name: np.repeat(value, self._steps, axis=1) for name, value in now.items()})

    def restart(self, env: int, state: State) -> None:
        """Puts an environment to a state [1, ...], as if it had been there all along the interval."""
        for name, value in state.items():
            self.before[name][env] = self.now[name][env] = self.last[name][env] = value[0]
        self.stay([env])

    def close(self) -> Interval:
        """Gives the interval, of which all environments were written."""
        self.stamp, self.grid = self._to, self.grid + self._steps * self._step_ns
        moving = self._assembly.may_move[self._moves]
        poses, twists = self._poses, self._twists
        if not self._moves.all():
            poses, twists = poses[:, :, self._moves], twists[:, :, self._moves]
        result = Interval(self._t, self._end_poses, moving, poses, twists, lasting=True)
        if self._joints:
            result.qpos, result.qvel = (self._of_joints[name] for name in JOINTS)
        del self._poses, self._twists, self._end_poses, self._of_joints
        return result

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
        """Lets environments be at rest in the state at their last grid point."""
        chosen = list(envs)
        self.now["twist"][chosen] = 0.0
        for name, value in self.now.items():
            self.before[name][chosen] = self.last[name][chosen] = value[chosen]
