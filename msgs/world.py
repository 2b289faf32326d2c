"""Defines the messages about the simulated world: time, actions, body states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from msgs.fields import MessageError, array
from msgs.header import Header, Message
from msgs.own_time import ORIGIN, own_rows

EVERY = slice(None)
"""All environments."""


@dataclass
class Clock(Message):
    """Carries the current time (header.stamp_ns) and how fast it runs against the wall clock."""

    header: Header
    real_time_factor: float = 0.0


@dataclass
class Action(Message):
    """Carries controls for the step that starts at header.stamp_ns."""

    header: Header
    controls: np.ndarray = array("float64", "E nu", "actuator controls, in the units of the model's actuators")


@dataclass
class Reset(Message):
    """Asks physics to begin environments anew: the next state that it publishes is their start.

    `envs`: which; none named = all. `seeds`: of each of these, the seed of all that is random in it from then on, as a
    single run with that seed has; -1 = it keeps its seed, and what is random differs by the number of the reset.
    """

    header: Header
    envs: np.ndarray = array("int32", "?", "environments, none = all")
    seeds: np.ndarray = array("int64", "?", "seed of each of them, -1 = keep; none = all keep theirs")


@dataclass
class WorldState(Message):
    """Carries poses and twists of the bodies over the interval that ends at header.stamp_ns.

    Body n is `names[n]`; every camera of the scene is a body too, under its own name. In the first message of an
    episode S = 1; in every later one t[0] is the previous stamp and t[-1] is header.stamp_ns, so one message is enough
    to interpolate within its interval.

    Only the bodies that move within the interval, B of the N, come with all sub-steps; every other one is at its
    `end_pose` all along, without velocity. `rows` gives any body's sub-steps as if all were there, and `dense` makes a
    message of them. Where all motion is in closed form, and no reader asks for the sub-steps between, t are the two
    ends alone.

    Once an environment was reset by itself, each has sub-steps of its own, at `own_t` since its reset; an environment
    with fewer of them repeats its first, and `t` are those of one that has them all. A reset at the present stamp
    comes as a state of that very stamp, in which `episodes` has gone up where one begins anew; the other environments
    are then as they were.
    """

    VERSION: ClassVar[int] = 2

    header: Header
    t: np.ndarray = array("int64", "S", "sub-step times [ns], ascending")
    end_pose: np.ndarray = array("float64", "E N 7", "position [m], quaternion x y z w at t[-1], body to world")
    moving: np.ndarray = array("int32", "B", "bodies that move in the interval, ascending")
    moving_pose: np.ndarray = array("float64", "E S B 7", "poses of these; the last sub-step is their end_pose")
    moving_twist: np.ndarray = array("float64", "E S B 6", "their linear [m/s] and angular [rad/s] velocity, world")
    episodes: np.ndarray = array("int32", "E", "episode of each environment")
    qpos: np.ndarray | None = array("float64", "E S nq", "joint positions", optional=True)
    qvel: np.ndarray | None = array("float64", "E S nv", "joint velocities", optional=True)
    acceleration: np.ndarray | None = array(
        "float64", "E N 6", "linear [m/s^2] and angular [rad/s^2] acceleration at t[-1], world", optional=True
    )
    gravity: np.ndarray | None = array("float64", "E 3", "of the model that moves bodies [m/s^2], world", optional=True)
    contact_env: np.ndarray | None = array("int32", "M", "environment of each contact at t[-1]", optional=True)
    contact_body: np.ndarray | None = array("int32", "M 2", "body indices, -1 = world", optional=True)
    contact_position: np.ndarray | None = array("float64", "M 3", "world position [m]", optional=True)
    contact_normal: np.ndarray | None = array("float64", "M 3", "world normal, first to second body", optional=True)
    contact_force: np.ndarray | None = array("float64", "M 3", "force on the second body [N], world", optional=True)
    contact_distance: np.ndarray | None = array("float64", "M", "gap [m], negative = penetration", optional=True)
    own: np.ndarray | None = own_rows()
    own_t: np.ndarray | None = array("int64", "E S", "sub-step times in own time [ns], not descending", optional=True)
    names: list[str] = field(default_factory=list)

    @classmethod
    def dense(
        cls, header: Header, t: np.ndarray, pose: np.ndarray, twist: np.ndarray, episodes: np.ndarray, **others: Any
    ) -> WorldState:
        """Makes the message of all sub-steps of all bodies.

        t: int64 [S] ns. pose: float64 [E, S, N, 7]. twist: float64 [E, S, N, 6]. episodes: int32 [E]. others: the other
        fields, as they are.
        """
        moving = moving_bodies(pose, twist)
        end = np.ascontiguousarray(pose[:, -1])
        return cls(header, t, end, moving, pose[:, :, moving], twist[:, :, moving], episodes, **others)

    def kept_end_pose(self) -> np.ndarray:
        """Copies `end_pose`, for a reader that keeps it and never writes to it.

        Where all environments share memory, so do they in the copy.
        """
        if self.end_pose.strides[0]:
            return np.array(self.end_pose)
        return np.broadcast_to(np.array(self.end_pose[:1]), self.end_pose.shape)

    def rows(
        self, bodies: Sequence[int] | np.ndarray | None = None, envs: np.ndarray | slice = EVERY
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns poses float64 [E, S, n, 7] and twists [E, S, n, 6] of these bodies (None: all) at every sub-step, in
        these environments."""
        count = self.end_pose.shape[1]
        chosen = np.arange(count) if bodies is None else np.asarray(bodies, np.int64)
        place = np.full(count, -1)
        place[self.moving] = np.arange(len(self.moving))
        place = place[chosen]
        at = np.flatnonzero(place >= 0)
        end = self.end_pose[envs] if bodies is None else self.end_pose[envs][:, chosen]
        pose = np.repeat(end[:, None], len(self.t), axis=1)
        twist = np.zeros((*pose.shape[:3], 6))
        pose[:, :, at] = self.moving_pose[envs][:, :, place[at]]
        twist[:, :, at] = self.moving_twist[envs][:, :, place[at]]
        return pose, twist

    def end_twist(self) -> np.ndarray:
        """Returns the velocities of all bodies at t[-1], float64 [E, N, 6]."""
        twist = np.zeros((*self.end_pose.shape[:2], 6))
        twist[:, self.moving] = self.moving_twist[:, -1]
        return twist

    def times(self, env: int) -> np.ndarray:
        """Returns the sub-step times of one environment on the clock of the stamps, int64 [S] ns."""
        if self.own is None or self.own_t is None:
            return self.t
        return np.asarray(self.own_t[env] + self.own[env, ORIGIN])

    def check(self) -> None:
        """Checks as every message does; also raises MessageError unless `moving` names bodies there are, in order."""
        super().check()
        moving, count = np.asarray(self.moving), self.end_pose.shape[1]
        if moving.size and (moving[0] < 0 or moving[-1] >= count or (np.diff(moving) <= 0).any()):
            raise MessageError(f"WorldState.moving is not an ascending list of bodies 0 to {count - 1}")


def moving_bodies(pose: np.ndarray, twist: np.ndarray) -> np.ndarray:
    """Finds the bodies, int32 ascending, that are not at one pose without velocity throughout, to the bit.

    pose float64 [E, S, N, 7], twist float64 [E, S, N, 6].
    """
    return np.flatnonzero(moves(pose, twist)).astype(np.int32)


def moves(pose: np.ndarray, twist: np.ndarray) -> np.ndarray:
    """Tells which bodies `moving_bodies` finds, bool [N]; arguments as there."""
    bits, last = _bits(pose), _bits(pose[:, -1:])
    different: np.ndarray = (bits != last).any(axis=(0, 1, 3)) | _bits(twist).any(axis=(0, 1, 3))
    return different


def _bits(values: np.ndarray) -> np.ndarray:
    """So that -0.0 is not 0.0, and NaN is itself."""
    return np.ascontiguousarray(values).view(np.int64)
