"""Messages about the simulated world: time, actions, body states."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from msgs.fields import array
from msgs.header import Header, Message


@dataclass
class Clock(Message):
    """The current time (header.stamp_ns) and how fast it runs against the wall clock."""

    header: Header
    real_time_factor: float = 0.0


@dataclass
class Action(Message):
    """Controls for the step that starts at header.stamp_ns."""

    header: Header
    controls: np.ndarray = array("float64", "E nu", "actuator controls, in the units of the model's actuators")


@dataclass
class WorldState(Message):
    """Poses and twists of the bodies over the interval that ends at header.stamp_ns.

    Body n is `names[n]`; every camera of the scene is a body too, under its own name. In the first message of an
    episode S = 1; in every later one t[0] is the previous stamp and t[-1] is header.stamp_ns, so one message is enough
    to interpolate within its interval.
    """

    header: Header
    t: np.ndarray = array("int64", "S", "sub-step times [ns], ascending")
    pose: np.ndarray = array("float64", "E S N 7", "position [m] and quaternion x y z w, body to world")
    twist: np.ndarray = array("float64", "E S N 6", "linear [m/s] and angular [rad/s] velocity, world frame")
    episodes: np.ndarray = array("int32", "E", "episode of each environment")
    qpos: np.ndarray | None = array("float64", "E S nq", "joint positions", optional=True)
    qvel: np.ndarray | None = array("float64", "E S nv", "joint velocities", optional=True)
    contact_env: np.ndarray | None = array("int32", "M", "environment of each contact at t[-1]", optional=True)
    contact_body: np.ndarray | None = array("int32", "M 2", "body indices, -1 = world", optional=True)
    contact_position: np.ndarray | None = array("float64", "M 3", "world position [m]", optional=True)
    contact_normal: np.ndarray | None = array("float64", "M 3", "world normal, first to second body", optional=True)
    contact_force: np.ndarray | None = array("float64", "M 3", "force on the second body [N], world", optional=True)
    contact_distance: np.ndarray | None = array("float64", "M", "gap [m], negative = penetration", optional=True)
    names: list[str] = field(default_factory=list)
