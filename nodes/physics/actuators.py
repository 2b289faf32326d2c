"""Describes the actuators of a model, and checks the controls that they are given."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np

from evis.runtime.clock import NS

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

    @property
    def count(self) -> int:
        """Counts the controls, nu."""
        return len(self.names)


def check_controls(controls: np.ndarray, envs: int, actuators: Actuators) -> None:
    """Raises ValueError, which names environment and actuator, unless controls are finite and [envs, nu]."""
    if controls.shape != (envs, actuators.count):
        raise ValueError(
            f"an action has controls {list(controls.shape)}, the model takes [{envs}, {actuators.count}] "
            f"(environments, actuators: {', '.join(actuators.names) or 'none'})"
        )
    wrong = ~np.isfinite(controls)
    if wrong.any():
        env, u = np.argwhere(wrong)[0]
        raise ValueError(
            f"an action has {controls[env, u]} for actuator '{actuators.names[u]}' of environment {env}; it must be "
            "finite"
        )


def check_controls_in_range(controls: np.ndarray, envs: int, actuators: Actuators) -> None:
    """Raises ValueError as check_controls does, and unless controls are within their ranges, or beyond them by no more
    than the rounding of a bound to float32, which networks give.

    For what comes from a program outside the graph, or from its caller: a controller within it may rely on the model,
    which clips.
    """
    check_controls(controls, envs, actuators)
    wrong = (controls < np.minimum(actuators.low, _rounded(actuators.low))) | (
        controls > np.maximum(actuators.high, _rounded(actuators.high))
    )
    if wrong.any():
        env, u = np.argwhere(wrong)[0]
        raise ValueError(
            f"an action has {controls[env, u]:.6g} for actuator '{actuators.names[u]}' of environment {env}; its range "
            f"is {actuators.low[u]:.6g} to {actuators.high[u]:.6g}"
        )


def actions_without_effect(rate: Fraction, keyframe_rate: Fraction, step_ns: int) -> str:
    """Tells which actions never act, as they come faster than steps; "" where each has a step.

    rate: of actions, keyframe_rate: of keyframes [Hz]. step_ns: length of a step [ns].
    """
    step = Fraction(step_ns, NS)
    if rate * step <= 1:
        return ""
    shorter, slower = math.floor(NS / rate) / NS, float(keyframe_rate / math.ceil(keyframe_rate * step))
    return (
        f"actions come every {float(1 / rate):.6g} s and steps are {float(step):.6g} s: an action acts from the next "
        f"step on, so that only {float(1 / (rate * step)):.3g} of them act at all; timestep:={shorter:.9g} gives each "
        f"a step, action_rate:={slower:.9g} each step an action"
    )


def _rounded(bounds: np.ndarray) -> np.ndarray:
    """Rounds bounds to float32, but for those too large for it."""
    with np.errstate(over="ignore"):
        rounded = bounds.astype(np.float32).astype(np.float64)
    return np.where(np.isfinite(rounded), rounded, bounds)
