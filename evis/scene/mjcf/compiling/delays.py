"""Converts delays of a model's actuators, in steps other than the model's own.

MuJoCo keeps the last `nsample` controls of a delayed actuator, one of each step: where they do not reach back as far as
`delay`, the oldest acts. Steps that are shorter than the model's would so shorten the delay.
"""

from __future__ import annotations

import math
from typing import Any

import mujoco

from evis.scene.errors import SceneError
from evis.scene.mjcf.compiling.check import MAX_NUMBER
from evis.scene.mjcf.frames import name_of

FINER = 2
"""The course beside a run, that tells its error, is taken in steps of down to half the length."""


def keep_delays(spec: Any, file: str, step: float) -> None:
    """Makes the histories of an MjSpec's actuators long enough for their delays in steps of `step` [s].

    Raises SceneError that names the file for one that would be too long.
    """
    timestep = spec.option.timestep
    for number, actuator in enumerate(spec.actuators):
        if actuator.delay <= 0:
            continue
        actuator.delay = min(actuator.delay, actuator.nsample * timestep)
        samples = math.ceil(FINER * max(actuator.nsample, actuator.nsample * timestep / step))
        if samples > MAX_NUMBER:
            raise SceneError(
                f"{file}: actuator '{actuator.name or f'actuator{number}'}' has a delay of {actuator.delay:g} s, for "
                f"which steps of {step:g} s need {samples} samples; {MAX_NUMBER} is the most, so take longer steps"
            )
        actuator.nsample = samples


def delayed(model: Any) -> str | None:
    """Names the first actuator of a model that has a delay, None where none has."""
    for number in range(model.nactuator):
        if model.actuator_delay[number] > 0:
            return name_of(model, mujoco.mjtObj.mjOBJ_ACTUATOR, number, "actuator")
    return None
