"""Computes prescribed motion: poses and twists of a body in closed form.

A motion computes with arrays of its own leading shape: that of one body has none, and what is `stacked` of those of B
bodies has one of B, and gives [B, S, ...] where one of them gives [S, ...], bit by bit the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import Any, TypeVar

import numpy as np

from evis.geometry import se3
from evis.scene.spline import Spline, Splines

NS = 1e-9
"""Seconds per nanosecond."""


@dataclass(frozen=True)
class Linear:
    """Moves at a constant velocity [m/s] in the parent's frame."""

    velocity: np.ndarray

    def shift(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Computes displacement and velocity [S, 3] at times [S] s."""
        displacement = t[:, None] * self.velocity
        return displacement, np.broadcast_to(self.velocity, displacement.shape)

    def acceleration(self, t: np.ndarray) -> np.ndarray:
        """Computes the second derivative of the displacement [S, 3] at times [S] s."""
        return np.zeros((len(t), 3))


@dataclass(frozen=True)
class Sinusoid:
    """Moves by amplitude sin(2 pi frequency t + phase) [m] in the parent's frame."""

    amplitude: np.ndarray
    frequency: float
    phase: float = 0.0

    def shift(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Computes displacement and velocity [S, 3] at times [S] s."""
        rate = 2 * np.pi * self.frequency
        angle = rate * t + self.phase
        return np.sin(angle)[..., None] * self.amplitude, (rate * np.cos(angle))[..., None] * self.amplitude

    def acceleration(self, t: np.ndarray) -> np.ndarray:
        """Computes the second derivative of the displacement [S, 3] at times [S] s."""
        rate = 2 * np.pi * self.frequency
        return np.outer(-(rate**2) * np.sin(rate * t + self.phase), self.amplitude)


@dataclass(frozen=True)
class Spin:
    """Turns at a constant rate [rad/s] about a unit axis of the body's frame."""

    axis: np.ndarray
    rate: float

    def turn(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Computes angle [rad] and angular rate [rad/s], [S], at times [S] s."""
        angle = self.rate * t
        return angle, np.broadcast_to(self.rate, angle.shape)

    def acceleration(self, t: np.ndarray) -> np.ndarray:
        """Computes the angular acceleration [rad/s^2], [S], at times [S] s."""
        return np.zeros(len(t))


@dataclass(frozen=True)
class Swing:
    """Turns by amplitude [rad] times sin(2 pi frequency t + phase) about a unit axis of the body's frame."""

    axis: np.ndarray
    amplitude: float
    frequency: float
    phase: float = 0.0

    def turn(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Computes angle [rad] and angular rate [rad/s], [S], at times [S] s."""
        rate = 2 * np.pi * self.frequency
        angle = rate * t + self.phase
        return self.amplitude * np.sin(angle), self.amplitude * rate * np.cos(angle)

    def acceleration(self, t: np.ndarray) -> np.ndarray:
        """Computes the angular acceleration [rad/s^2], [S], at times [S] s."""
        rate = 2 * np.pi * self.frequency
        return -self.amplitude * rate**2 * np.sin(rate * t + self.phase)


@dataclass(frozen=True)
class Path:
    """Moves along a spline through points [m] in the parent's frame; they add to the start position."""

    spline: Spline

    def shift(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Computes displacement and velocity [S, 3] at times [S] s."""
        return self.spline(t)

    def acceleration(self, t: np.ndarray) -> np.ndarray:
        """Computes the second derivative of the displacement [S, 3] at times [S] s."""
        return self.spline.bend(t)


@dataclass(frozen=True)
class Turn:
    """Turns by a spline of angles [rad] about a unit axis of the body's frame.

    Chained, as yaw, pitch and roll say, they are a rotation with smooth angular velocity known in closed form.
    """

    axis: np.ndarray
    spline: Spline

    def turn(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Computes angle [rad] and angular rate [rad/s], [S], at times [S] s."""
        angle, rate = self.spline(t)
        return angle[..., 0], rate[..., 0]

    def acceleration(self, t: np.ndarray) -> np.ndarray:
        """Computes the angular acceleration [rad/s^2], [S], at times [S] s."""
        return self.spline.bend(t)[..., 0]


Shift = Linear | Sinusoid | Path
Rotation = Spin | Swing | Turn
Motion = Shift | Rotation
Kind = TypeVar("Kind", bound=Motion)


def kind(motion: Motion) -> tuple[Any, ...]:
    """Tells motions apart that cannot be stacked: those of the same kind can."""
    if isinstance(motion, (Path, Turn)):
        return type(motion).__name__, motion.spline.loop, motion.spline.times.tobytes()
    return (type(motion).__name__,)


def stacked(motions: Sequence[Kind]) -> Kind:
    """Makes one motion of those of B bodies, which are of the same kind: its fields have a leading axis, of B."""
    values: dict[str, Any] = {}
    for field in fields(motions[0]):
        each = [getattr(motion, field.name) for motion in motions]
        values[field.name] = Splines(each) if isinstance(each[0], Spline) else np.stack(each)[:, None]
    return type(motions[0])(**values)


def local_pose(
    start: np.ndarray,
    shifts: Sequence[Shift],
    turns: Sequence[Rotation],
    t: np.ndarray,
    twist: np.ndarray | None = None,
) -> np.ndarray:
    """Computes poses [..., S, 7] in the parent's frame, at times [S] s.

    start: float64 [..., 7]; the motions are stacked where it has a leading axis. twist: zeros [..., S, 6], to which the
    twists are written; None = they are left out, which takes two thirds of the time.
    """
    shape = (*start.shape[:-1], len(t))
    position, rotation = (
        np.broadcast_to(part[..., None, :], (*shape, part.shape[-1])).copy()
        for part in (start[..., :3], start[..., 3:])
    )
    for shift in shifts:
        displacement, velocity = shift.shift(t)
        position += displacement
        if twist is not None:
            twist[..., :3] += velocity
    for turn in turns:
        angle, rate = turn.turn(t)
        if twist is not None:
            twist[..., 3:] += rate[..., None] * se3.rotate(rotation, turn.axis)
        rotation = se3.multiply(rotation, se3.exp(angle[..., None] * turn.axis))
    return se3.make_pose(position, rotation)


def local_state(
    start: np.ndarray, shifts: Sequence[Shift], turns: Sequence[Rotation], t: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Computes poses as `local_pose` does, and twists [..., S, 6] in the parent's frame."""
    twist = np.zeros((*start.shape[:-1], len(t), 6))
    return local_pose(start, shifts, turns, t, twist), twist


def carried(
    carrier: tuple[np.ndarray, np.ndarray], state: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Computes poses and twists in the world of what has this state in the frame of a carrier with that state."""
    return se3.compose(carrier[0], state[0]), se3.compose_twist(*carrier, *state)


class Prescribed:
    """Composes a motion from a start pose, translations that add up in the parent's frame, and rotations that chain in
    the body's own.

    position(t) = p0 + sum of shifts(t); rotation(t) = q0 turn_1(t) turn_2(t) ...; all of it in the frame of `parent`,
    or of the world. Exact at every t, whatever the sub-step.
    """

    def __init__(
        self,
        start: np.ndarray,
        motions: Sequence[Motion] = (),
        parent: Prescribed | None = None,
    ) -> None:
        self.start = np.asarray(start, np.float64)
        self.shifts = [m for m in motions if isinstance(m, Shift)]
        self.turns = [m for m in motions if isinstance(m, Rotation)]
        self.parent = parent
        self._static = not self.shifts and not self.turns and (parent is None or parent.is_static())
        self._still: np.ndarray | None = None

    def pose(self, t_ns: np.ndarray) -> np.ndarray:
        """Computes the poses float64 [S, 7] at times int64 [S] ns, in the world."""
        return self.state(t_ns)[0]

    def twist(self, t_ns: np.ndarray) -> np.ndarray:
        """Computes the twists float64 [S, 6] (v, omega; world frame) at times int64 [S] ns."""
        return self.state(t_ns)[1]

    def is_static(self) -> bool:
        """Returns True when the pose never changes."""
        return self._static

    def never_turns(self) -> bool:
        """Returns True when the orientation never changes."""
        return not self.turns and (self.parent is None or self.parent.never_turns())

    @property
    def depth(self) -> int:
        """Counts the parents above this motion, one on the other: 0 without one."""
        return 0 if self.parent is None else 1 + self.parent.depth

    def state(self, t_ns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Computes pose and twist at once, which costs no more than the twist alone."""
        if self._static:
            return self._still_pose(np.size(t_ns)), np.zeros((np.size(t_ns), 6))
        t = np.atleast_1d(np.asarray(t_ns, np.int64)) * NS
        pose, twist = local_state(self.start, self.shifts, self.turns, t)
        return (pose, twist) if self.parent is None else carried(self.parent.state(t_ns), (pose, twist))

    def acceleration(self, t_ns: np.ndarray) -> np.ndarray:
        """Computes the accelerations float64 [S, 6] (linear, angular; world frame) at times int64 [S] ns.

        A chain of turns: each one's axis is carried round by those before it. In a parent that moves: Euler's,
        centripetal and Coriolis's terms (Craig, Introduction to Robotics, ch. 6).
        """
        t = np.atleast_1d(np.asarray(t_ns, np.int64)) * NS
        rotation = np.tile(self.start[3:], (len(t), 1))
        omega, result = np.zeros((len(t), 3)), np.zeros((len(t), 6))
        for shift in self.shifts:
            result[:, :3] += shift.acceleration(t)
        for turn in self.turns:
            angle, rate = turn.turn(t)
            axis = se3.rotate(rotation, turn.axis)
            result[:, 3:] += turn.acceleration(t)[:, None] * axis + rate[:, None] * se3.cross(omega, axis)
            omega = omega + rate[:, None] * axis
            rotation = se3.multiply(rotation, se3.exp(angle[:, None] * turn.axis))
        if self.parent is None:
            return result
        carrier, moving = self.parent.state(t_ns)
        alone = Prescribed(self.start, [*self.shifts, *self.turns])
        return se3.compose_acceleration(carrier, moving, self.parent.acceleration(t_ns), *alone.state(t_ns), result)

    def _still_pose(self, count: int) -> np.ndarray:
        """The one pose of a body that never moves, worked out once: a scene has hundreds of them."""
        if self._still is None:
            still = self.parent._still_pose(1)[0] if self.parent else None
            self._still = self.start if still is None else se3.compose(still, self.start)
        return np.repeat(self._still[None], count, axis=0)


def may_turn(trajectory: object) -> bool:
    """Returns False for what a trajectory never turns; True for None, which the physics engine moves."""
    return not (isinstance(trajectory, Prescribed) and trajectory.never_turns())


def with_parents(paths: Iterable[Prescribed]) -> list[Prescribed]:
    """Lists the paths and all that carries them, each once."""
    found: dict[int, Prescribed] = {}
    for path in paths:
        node: Prescribed | None = path
        while node is not None and id(node) not in found:
            found[id(node)] = node
            node = node.parent
    return list(found.values())
