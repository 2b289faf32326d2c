"""Holds the result of a physics engine for one step of the graph, and the grid of sub-steps that engines share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from msgs.world import moving_bodies


@dataclass
class Contacts:
    """Holds M contacts, ordered by environment; fields as in WorldState."""

    env: np.ndarray
    body: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    force: np.ndarray
    distance: np.ndarray

    @classmethod
    def joined(cls, parts: Sequence[Contacts], numbers: Sequence[Sequence[int] | np.ndarray]) -> Contacts:
        """Joins the contacts of groups of environments. numbers: of each group, which of all its environments are."""
        env = np.concatenate([np.asarray(own, np.int32)[part.env] for part, own in zip(parts, numbers)])
        order = np.argsort(env, kind="stable")
        columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])}
        return cls(**{name: values[order] for name, values in (columns | {"env": env}).items()})

    def of(self, chosen: np.ndarray) -> Contacts:
        """Selects the contacts of some environments; chosen: bool, of each that there is."""
        which = chosen[self.env]
        return Contacts(**{name: values[which] for name, values in vars(self).items()})


@dataclass(frozen=True)
class Extras:
    """Selects what intervals of an engine have beside poses and twists.

    contacts: those with their forces. joints: positions and velocities of the joints. accelerations: of the bodies, NaN
    for cameras that MuJoCo has follow a body.
    """

    contacts: bool = False
    joints: bool = False
    accelerations: bool = False


@dataclass
class Interval:
    """Holds the states from the previous stamp to the new one, or at one instant (S = 1).

    t int64 [S] ns; end_pose float64 [E, N, 7]; moving int32 [B], moving_pose float64 [E, S, B, 7] and moving_twist
    [E, S, B, 6] as in WorldState; qpos [E, S, nq], qvel [E, S, nv] and acceleration [E, N, 6] where asked for.
    gravity [E, 3] where a model moves bodies.
    faults: (environment, text) of each environment that diverged and was put back to its start. warnings: the same of
    what may be wrong without having diverged. own_t: as in WorldState, where environments were reset by themselves.
    lasting: whether nobody writes to these arrays any more, so that they are published as they are; of
    environments that move alike they may share memory.
    again: how many environments MuJoCo stepped again in the place of MuJoCo Warp.
    """

    t: np.ndarray
    end_pose: np.ndarray
    moving: np.ndarray
    moving_pose: np.ndarray
    moving_twist: np.ndarray
    qpos: np.ndarray | None = None
    qvel: np.ndarray | None = None
    contacts: Contacts | None = None
    acceleration: np.ndarray | None = None
    gravity: np.ndarray | None = None
    faults: list[tuple[int, str]] = field(default_factory=list)
    warnings: list[tuple[int, str]] = field(default_factory=list)
    own_t: np.ndarray | None = None
    lasting: bool = False
    again: int = 0

    @classmethod
    def dense(cls, t: np.ndarray, pose: np.ndarray, twist: np.ndarray, **others: Any) -> Interval:
        """Makes the interval of all bodies' sub-steps: pose float64 [E, S, N, 7], twist float64 [E, S, N, 6]."""
        moving = moving_bodies(pose, twist)
        return cls(t, pose[:, -1], moving, pose[:, :, moving], twist[:, :, moving], **others)

    @property
    def pose(self) -> np.ndarray:
        """Gives the poses of all bodies at every sub-step, float64 [E, S, N, 7]."""
        pose = np.repeat(self.end_pose[:, None], len(self.t), axis=1)
        pose[:, :, self.moving] = self.moving_pose
        return pose

    @property
    def twist(self) -> np.ndarray:
        """Gives the velocities of all bodies at every sub-step, float64 [E, S, N, 6]."""
        envs, bodies, _ = self.end_pose.shape
        twist = np.zeros((envs, len(self.t), bodies, 6))
        twist[:, :, self.moving] = self.moving_twist
        return twist

    def keep_last(self) -> None:
        """Leaves out all sub-steps but the last."""
        last = slice(-1, None)
        self.t = self.t[last]
        self.moving_pose, self.moving_twist = self.moving_pose[:, last], self.moving_twist[:, last]
        if self.qpos is not None and self.qvel is not None:
            self.qpos, self.qvel = self.qpos[:, last], self.qvel[:, last]
        if self.own_t is not None:
            self.own_t = self.own_t[:, last]


def grid_inside(start_ns: int, end_ns: int, step_ns: int) -> np.ndarray:
    """Gives the multiples of step_ns strictly between two stamps, int64."""
    return np.arange(start_ns // step_ns + 1, -(-end_ns // step_ns), dtype=np.int64) * step_ns
