"""Describes the actuators of a MuJoCo model."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from nodes.physics.actuators import Actuators


def actuators_of(model: Any) -> Actuators:
    """Reads names and ranges of the controls, in the units that the model has; an actuator may have several."""
    limited = np.asarray(model.actuator_ctrllimited, bool)
    span = np.asarray(model.actuator_ctrlrange, np.float64).reshape(-1, 2)
    low, high = np.where(limited, span[:, 0], -np.inf), np.where(limited, span[:, 1], np.inf)
    names = [name for k in range(model.nactuator) for name in _names(model, k)]
    return Actuators(tuple(names), low, high)


def _names(model: Any, actuator: int) -> list[str]:
    """Names each control of an actuator, numbered where there are several."""
    name, count = _name(model, actuator), int(model.actuator_ctrlnum[actuator])
    return [name] if count == 1 else [f"{name}[{k}]" for k in range(count)]


def _name(model: Any, actuator: int) -> str:
    name = str(model.actuator(actuator).name)
    if not name and model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT:
        name = str(model.joint(int(model.actuator_trnid[actuator, 0])).name)
    return name or f"actuator{actuator}"
