"""Describes the actuators of a MuJoCo model."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from nodes.physics.from_outside import Actuators


def actuators_of(model: Any) -> Actuators:
    """Reads names and ranges, in the units that the model has."""
    limited = np.asarray(model.actuator_ctrllimited, bool)
    span = np.asarray(model.actuator_ctrlrange, np.float64).reshape(-1, 2)
    low, high = np.where(limited, span[:, 0], -np.inf), np.where(limited, span[:, 1], np.inf)
    return Actuators(tuple(_name(model, k) for k in range(model.nu)), low, high)


def _name(model: Any, actuator: int) -> str:
    name = str(model.actuator(actuator).name)
    if not name and model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT:
        name = str(model.joint(int(model.actuator_trnid[actuator, 0])).name)
    return name or f"actuator{actuator}"
