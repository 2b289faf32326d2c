"""Checks actions from a program outside a running graph, or from its caller, before they act."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from msgs.world import Action

NO_ACTUATORS = "has no actuators (`actuators:` in a scene file gives them to joints of its MJCF or URDF)"


@dataclass(frozen=True)
class Actuators:
    """Describes the actuators of a model.

    names [nu]: their own, or those of their joints. low, high: lowest and highest control, float64 [nu], infinite if
    free.
    """

    names: tuple[str, ...] = ()
    low: np.ndarray = field(default_factory=lambda: np.empty(0))
    high: np.ndarray = field(default_factory=lambda: np.empty(0))


def check_action(action: Action, envs: int, actuators: Actuators) -> None:
    """Raises ValueError as `check_controls` does."""
    check_controls(np.asarray(action.controls), envs, actuators)


def check_controls(controls: np.ndarray, envs: int, actuators: Actuators) -> None:
    """Raises ValueError naming environment and actuator unless controls [E, nu] are finite and within their ranges, or
    beyond them by no more than the rounding of a bound to float32, which networks give.
    """
    count = len(actuators.names)
    if controls.shape != (envs, count):
        raise ValueError(
            f"an action has controls {list(controls.shape)}, the model takes [{envs}, {count}] (environments, "
            f"actuators: {', '.join(actuators.names)})"
        )
    wrong = ~np.isfinite(controls)
    if wrong.any():
        env, u = np.argwhere(wrong)[0]
        raise ValueError(
            f"an action has {controls[env, u]} for actuator '{actuators.names[u]}' of environment {env}; it must be "
            "finite"
        )
    wrong = (controls < np.minimum(actuators.low, _rounded(actuators.low))) | (
        controls > np.maximum(actuators.high, _rounded(actuators.high))
    )
    if wrong.any():
        env, u = np.argwhere(wrong)[0]
        raise ValueError(
            f"an action has {controls[env, u]:.6g} for actuator '{actuators.names[u]}' of environment {env}; its range "
            f"is {actuators.low[u]:.6g} to {actuators.high[u]:.6g}"
        )


def _rounded(bounds: np.ndarray) -> np.ndarray:
    """Bounds in float32, but those that are too large for it."""
    with np.errstate(over="ignore"):
        rounded = bounds.astype(np.float32).astype(np.float64)
    return np.where(np.isfinite(rounded), rounded, bounds)
