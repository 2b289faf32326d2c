"""Describes a case of the dynamics: a world, how it starts, and a function for the error of its course."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

MS = 1_000_000
INTEGRATORS = ("Euler", "implicit", "implicitfast", "RK4", "discrete")
STEPS = (MS, MS // 4, MS // 16, MS // 64)
"""Time steps [ns], the longest that the engine takes first. All divide a millisecond."""
TOLERANCES = (1e-2, 1e-3, 1e-4)
"""Values of physics_tolerance, of metres and of radians, of a model that says nothing else."""
NO_GRAVITY = "gravity='0 0 0'"
G = 9.81
EARTH = f"gravity='0 0 -{G}'"


@dataclass(frozen=True)
class Course:
    """Holds what physics published of a run: float64, S instants, bodies in the order of the model.

    t [S] s; pose [S, B, 7] and twist [S, B, 6] as in WorldState; qpos [S, nq].
    """

    t: np.ndarray
    pose: np.ndarray
    twist: np.ndarray
    qpos: np.ndarray


@dataclass(frozen=True)
class Case:
    """Describes a world whose course is known.

    Args:
        name: what it is.
        group: the plot that it is in.
        truth: what is known of its course, and from where.
        unit: of the error.
        limit: largest error that counts as right; what a camera near by would not see.
        seconds: how long it runs.
        error: how far a course is from the truth.
        world: inside of MJCF's <worldbody>.
        start: attributes of the MJCF keyframe at which it starts.
        option: attributes of <option>, beside the integrator.
        rest: what stands after <worldbody>.
        controls: of the actuators, all along.
        steps: time steps [ns].
        integrators: those that are run.
        tolerances: of physics_tolerance.
        estimated: whether the error is the largest distance or angle of a body from where exact integration of its
            model has it, which a run estimates of itself.
        sample_ns: times at which a course is looked at, multiples of this; 0 = every step.
    """

    name: str
    group: str
    truth: str
    unit: str
    limit: float
    seconds: float
    error: Callable[[Course], float]
    world: str
    start: str = ""
    option: str = NO_GRAVITY
    rest: str = ""
    controls: tuple[float, ...] = ()
    steps: tuple[int, ...] = STEPS
    integrators: tuple[str, ...] = INTEGRATORS
    tolerances: tuple[float, ...] = TOLERANCES
    estimated: bool = False
    sample_ns: int = MS


def farthest(found: np.ndarray, expected: np.ndarray) -> float:
    """Computes the largest distance of points: float64 [..., n] each."""
    return float(np.linalg.norm(found - expected, axis=-1).max())


def displaced(course: Course) -> float:
    """Computes how far a body ever is from where it was first [m]: the error of what should stand."""
    place = course.pose[..., :3]
    return farthest(place, place[:1])
