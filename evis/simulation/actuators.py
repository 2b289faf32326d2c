"""Describes the actuators of a simulation, and what a caller may give as an action, as physics describes and checks
both."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from evis.scene.model import Scene
from evis.simulation.errors import SimulationError
from nodes.physics.actuators import Actuators, check_controls_in_range


@dataclass(frozen=True)
class Actuator:
    """Describes one actuator. low, high: range of its control in the model's units; infinite where it has none."""

    name: str
    low: float
    high: float


def each(actuators: Actuators) -> tuple[Actuator, ...]:
    """Lists actuators one by one."""
    return tuple(map(Actuator, actuators.names, actuators.low.tolist(), actuators.high.tolist()))


def actuators_of(scene: Scene) -> tuple[Actuators, np.ndarray]:
    """Reads the actuators of a scene's model, none where all motion is prescribed, and the controls float64 [nu] that
    it starts with.
    """
    if not scene.dynamic:
        return Actuators(), np.zeros(0)
    import mujoco

    from evis.scene.mjcf.dynamics import compile_model
    from nodes.physics.dynamics import actuators

    model = compile_model(scene)
    # not zero throughout: the setpoint of an orientation starts as the quaternion that turns nothing
    start = model.key_ctrl[scene.keyframe] if scene.keyframe >= 0 else mujoco.MjData(model).ctrl
    return actuators.actuators_of(model), np.array(start)


def controls_of(action: Any, envs: int, actuators: Actuators) -> np.ndarray:
    """Converts an action [nu] (of one environment) or [E, nu], wherever it is, to controls float64 [E, nu] within their
    ranges.

    Raises SimulationError for another shape, a value that is not finite or complex, or one that is out of its
    actuator's range by more than the rounding of a bound to float32.
    """
    try:
        if hasattr(action, "detach"):  # of torch, which converts neither what has a gradient nor what is on a GPU
            action = action.detach().cpu().numpy()
        elif hasattr(action, "numpy"):  # of Warp
            action = action.numpy()
        if np.iscomplexobj(action):
            raise TypeError("it has complex ones")
        values = np.array(action, np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise SimulationError(f"the action is no array of numbers: {error}") from None
    if values.ndim == 1 and envs == 1:
        values = values[None]
    try:
        check_controls_in_range(values, envs, actuators)
    except ValueError as error:
        raise SimulationError(str(error)) from None
    return np.clip(values, actuators.low, actuators.high)
