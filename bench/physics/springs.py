"""Makes cases of springs and servos, from soft to far stiffer than a step can follow."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bench.physics.case import MS, STEPS, Case, Course
from bench.physics.references import oscillator

AMPLITUDES = {2: 0.1, 4: 0.1, 6: 0.1, 8: 0.05, 10: 0.005}
"""Where springs are let go [m], by the power of ten of their stiffness: below the speed at which a run is over."""
FINE = (MS, MS // 16, MS // 250, MS // 1000)
"""Steps for 1e5 rad/s."""


def cases(quick: bool) -> list[Case]:
    """Lists springs of 1 kg without damping and with critical damping, and servos of 1 kg m^2 that turn to 1 rad."""
    found = []
    for zeta, damped in ((0.0, "undamped"), (1.0, "critically damped")):
        for power in (2, 4, 6, 8, 10):
            omega = 10.0 ** (power / 2)
            joint = f"<joint type='slide' axis='1 0 0' stiffness='{omega**2}' damping='{2 * zeta * omega}'/>"
            found.append(
                Case(
                    f"spring of 1e{power} N/m and 1 kg, {damped}", "springs", "closed form", "m", 1e-3,
                    0.05 if power == 10 else 0.2 if power == 8 else 1.0, _spring(AMPLITUDES[power], omega, zeta),
                    f"<body name='mass'>{joint}<geom size='.1' mass='1'/></body>", f"qpos='{AMPLITUDES[power]}'",
                    steps=FINE if power == 10 else STEPS, sample_ns=MS if power < 8 else 0, estimated=True,
                )
            )  # fmt: skip
    arm = "<body name='arm'><joint name='hinge' axis='0 0 1'/><inertial pos='0 0 0' mass='1' diaginertia='1 1 1'/>"
    for power in (3, 4, 5, 6):
        omega = 10.0 ** (power / 2)
        servo = f"<actuator><position joint='hinge' kp='{omega**2}' kv='{2 * omega}'/></actuator>"
        found.append(
            Case(
                f"servo of 1e{power} N m/rad, critically damped", "springs", "closed form", "deg", 0.1, 0.5,
                _servo(omega), f"{arm}<geom size='.1'/></body>", rest=servo, controls=(1.0,), estimated=True,
            )
        )  # fmt: skip
    return found


def _spring(amplitude: float, omega: float, zeta: float) -> Callable[[Course], float]:
    def error(course: Course) -> float:
        return float(np.abs(course.pose[:, 0, 0] - amplitude * oscillator(omega, zeta, course.t)).max())

    return error


def _servo(omega: float) -> Callable[[Course], float]:
    def error(course: Course) -> float:
        return float(np.degrees(np.abs(course.qpos[:, 0] - (1 - oscillator(omega, 1.0, course.t))).max()))

    return error
