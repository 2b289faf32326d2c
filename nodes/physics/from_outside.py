"""What a program outside a running graph, or the caller of one, may ask of physics, checked before it is done: actions
and resets.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from msgs.world import Action, Reset


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
    """Raises ValueError naming environment and actuator unless controls [E, nu] are finite and within their ranges."""
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
    wrong = (controls < actuators.low) | (controls > actuators.high)
    if wrong.any():
        env, u = np.argwhere(wrong)[0]
        raise ValueError(
            f"an action has {controls[env, u]:.6g} for actuator '{actuators.names[u]}' of environment {env}; its range "
            f"is {actuators.low[u]:.6g} to {actuators.high[u]:.6g}"
        )


def check_reset(reset: Reset, envs: int) -> None:
    """Raises ValueError naming what is wrong with the environments or seeds of a reset."""
    chosen = np.asarray(reset.envs)
    for env in chosen:
        if not 0 <= env < envs:
            raise ValueError(f"there is no environment {env} to reset; the run has 0 to {envs - 1}")
    if len(np.unique(chosen)) != len(chosen):
        raise ValueError(f"a reset names an environment twice: {chosen.tolist()}")
    count = len(chosen) or envs
    if len(reset.seeds) not in (0, count):
        raise ValueError(f"a reset has {len(reset.seeds)} seed(s) for {count} environment(s); give one to each or none")
    if len(reset.seeds) and np.min(reset.seeds) < -1:
        raise ValueError(f"a reset has the seed {np.min(reset.seeds)}; a seed is 0 or more, and -1 keeps it")
