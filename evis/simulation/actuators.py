"""The actuators of a scene's model, and actions checked against them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from evis.scene.model import Scene
from evis.simulation.errors import SimulationError


@dataclass(frozen=True)
class Actuator:
    """Describes one actuator. low, high: range of its control in the model's units; infinite where it has none."""

    name: str
    low: float
    high: float


@dataclass(frozen=True)
class Actuators:
    """Holds the actuators of a model, and the controls float64 [nu] that it starts with."""

    all: tuple[Actuator, ...] = ()
    start: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def controls(self, action: Any, envs: int) -> np.ndarray:
        """Converts an action [nu] (of one environment) or [E, nu] to controls float64 [E, nu].

        Raises SimulationError for another shape, a value that is not finite, or one out of its actuator's range.
        """
        values = _host(action)
        shape = (envs, len(self.all))
        if values.shape == (len(self.all),) and envs == 1:
            values = values[None]
        if values.shape != shape:
            one = f" or [{shape[1]}]" if envs == 1 else ""
            raise SimulationError(
                f"the action has shape {list(values.shape)}; it must be {list(shape)}{one}: environments, actuators "
                f"({', '.join(a.name for a in self.all)})"
            )
        if not np.isfinite(values).all():
            k, u = np.argwhere(~np.isfinite(values))[0]
            raise SimulationError(
                f"the action is {values[k, u]} for actuator {self.all[u].name} of environment {k}; it must be finite"
            )
        low, high = (np.array([getattr(a, end) for a in self.all]) for end in ("low", "high"))
        outside = (values < low) | (values > high)
        if outside.any():
            k, u = np.argwhere(outside)[0]
            raise SimulationError(
                f"the action is {values[k, u]:g} for actuator {self.all[u].name} of environment {k}, whose range is "
                f"{low[u]:g} to {high[u]:g}; clip it, as np.clip(action, low, high)"
            )
        return np.array(values, np.float64)


def _host(action: Any) -> np.ndarray:
    """An action as numpy's array, wherever it is."""
    try:
        if hasattr(action, "detach"):  # of torch, which converts neither what has a gradient nor what is on a GPU
            action = action.detach().cpu()
        elif hasattr(action, "numpy"):  # of Warp
            action = action.numpy()
        return np.asarray(action, np.float64)
    except (TypeError, ValueError) as error:
        raise SimulationError(f"the action is no array of numbers: {error}") from None


def actuators_of(scene: Scene) -> Actuators:
    """Reads the actuators of a scene's model; none where all motion is prescribed."""
    if not scene.dynamic:
        return Actuators()
    from evis.scene.mjcf.dynamics import compile_model

    model = compile_model(scene)
    ranges: Sequence[Any] = model.actuator_ctrlrange
    limited = model.actuator_ctrllimited
    found = tuple(
        Actuator(
            _name(model, u),
            *(map(float, ranges[u]) if limited[u] else (-np.inf, np.inf)),
        )
        for u in range(model.nu)
    )
    start = np.array(model.key_ctrl[scene.keyframe]) if scene.keyframe >= 0 else np.zeros(model.nu)
    return Actuators(found, start)


def _name(model: Any, number: int) -> str:
    """An actuator's name; that of the joint that it moves where it has none of its own."""
    import mujoco

    actuator = model.actuator(number)
    if actuator.name or model.actuator_trntype[number] != mujoco.mjtTrn.mjTRN_JOINT:
        return actuator.name or f"actuator{number}"
    return str(model.joint(model.actuator_trnid[number, 0]).name) or f"actuator{number}"
