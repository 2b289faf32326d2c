"""Makes cases of bodies in free motion, pendulums and chains."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np

from bench.physics.case import EARTH, MS, STEPS, Case, Course, G, farthest
from bench.physics.references import chain, free_body, pendulum
from evis.geometry import se3

INERTIA, TURNING = (1e-3, 2e-3, 3e-3), (0.05, 10.0, 0.05)
LINKS, LINK = 50, 0.02
RAISED = np.radians(149.0)
"""Where the pendulum is let go: far from the small swings that are easy."""


def cases(quick: bool) -> list[Case]:
    """Lists projectile, spins, the free asymmetric body, pendulum, chain and the pendulum of an hour."""
    ball = "<body name='ball'><freejoint/><geom size='.1' mass='1'/></body>"
    disk = "<body name='disk'><freejoint/><geom type='cylinder' size='.1 .001' mass='1'/></body>"
    racket = "<body name='racket'><freejoint/><inertial pos='0 0 0' mass='1' diaginertia='{} {} {}'/>"
    racket += "<geom size='.01'/></body>"
    hour = 10.0 if quick else 3600.0
    found = [
        Case("projectile", "free", "parabola", "m", 1e-3, 1.0, _parabola, ball, "qvel='3 0 5 0 0 0'", EARTH),
        *(
            Case(
                f"spin at {omega} rad/s", "free", "angle = omega t", "deg", 0.1, 1.0, _spin(omega), disk,
                f"qvel='0 0 0 0 0 {omega}'",
            )
            for omega in (50, 1000)
        ),
        Case(
            "asymmetric body turning freely", "free", "Euler's equations, RK4 at 0.1 ms", "deg", 0.1,
            2.0 if quick else 10.0, _attitude, racket.format(*INERTIA),
            f"qvel='0 0 0 {' '.join(map(str, TURNING))}'", steps=STEPS[:3],
        ),
        Case(
            "pendulum at 149 degrees", "free", "Jacobi's functions", "deg", 0.1, 3.0 if quick else 10.0, _swing,
            _pendulum(), f"qpos='{RAISED}'", EARTH, steps=STEPS[:3],
        ),
        Case(
            "pendulum at 149 degrees for an hour", "free", "Jacobi's functions", "deg",
            0.1, hour, _swing, _pendulum(), f"qpos='{RAISED}'", EARTH, steps=STEPS[:1],
            integrators=("Euler", "RK4"), tolerances=(), sample_ns=20 * MS,
        ),
        Case(
            "chain of 50 links", "free", "Lagrange's equations, RK4 at 0.1 ms", "m", 1e-3,
            0.3 if quick else 1.0, _hanging, _links(), "", EARTH,
        ),
    ]  # fmt: skip
    return [replace(case, estimated=True) for case in found]


def _parabola(course: Course) -> float:
    t = course.t
    expected = np.stack((3 * t, 0 * t, 5 * t - G * t**2 / 2), -1)
    return farthest(course.pose[:, 0, :3], expected)


def _spin(omega: float) -> Callable[[Course], float]:
    def error(course: Course) -> float:
        return _turned(course.pose[:, 0, 3:], se3.exp(np.outer(omega * course.t, [0.0, 0.0, 1.0])))

    return error


def _turned(found: np.ndarray, expected: np.ndarray) -> float:
    """Largest angle [deg] between quaternions [S, 4]."""
    angle = np.linalg.norm(se3.log(se3.multiply(found, se3.conjugate(expected))), axis=-1)
    return float(np.degrees(angle.max()))


def _attitude(course: Course) -> float:
    return _turned(course.pose[:, 0, 3:], _free_body(tuple(course.t.tolist())))


@lru_cache(1)
def _free_body(t: tuple[float, ...]) -> np.ndarray:
    return free_body(np.array(INERTIA), np.array(TURNING), np.array(t), 1e-4)


def _pendulum() -> str:
    """A ball of 1 kg at 1 m, without friction; the angle is 0 where it hangs."""
    joint = "<joint type='hinge' axis='0 1 0'/><inertial pos='0 0 -1' mass='1' diaginertia='1e-6 1e-6 1e-6'/>"
    return f"<body name='pendulum'>{joint}<geom size='.05' pos='0 0 -1'/></body>"


def _swing(course: Course) -> float:
    omega = np.sqrt(G / (1 + 1e-6))
    return float(np.degrees(np.abs(course.qpos[:, 0] - pendulum(float(RAISED), omega, course.t)).max()))


def _links() -> str:
    """Thin rods of 10 g, hinged about -y, so that the angle is that from x to z."""
    moment = 0.01 * LINK**2 / 12
    body = "<body pos='{} 0 0'><joint type='hinge' axis='0 -1 0'/>"
    body += f"<inertial pos='{LINK / 2} 0 0' mass='.01' diaginertia='1e-9 {moment} {moment}'/>"
    body += f"<geom type='capsule' size='.002' fromto='0 0 0 {LINK} 0 0' contype='0' conaffinity='0'/>"
    return "".join(body.format(LINK if n else 0) for n in range(LINKS)) + "</body>" * LINKS


def _hanging(course: Course) -> float:
    return farthest(course.pose[..., [0, 2]], _chain(tuple(course.t.tolist()))[:, :-1])


@lru_cache(1)
def _chain(t: tuple[float, ...]) -> np.ndarray:
    return chain(LINKS, LINK, G, np.array(t), 1e-4)
