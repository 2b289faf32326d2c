"""Tells by which power of their length the errors of a model's steps grow."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

RK4 = mujoco.mjtIntegrator.mjINT_RK4
_BY_THEMSELVES = (mujoco.mjtDyn.mjDYN_FILTEREXACT, mujoco.mjtDyn.mjDYN_DCMOTOR)
"""Activations that MuJoCo moves on by the exponential of a whole step, which RK4 does to the mean of its four rates."""


def order_of(model: Any) -> int:
    """Gives the order of a model's integrator where nothing is touched or limited: 4 of RK4, 1 of the others.

    RK4 is of order 1 too where an actuator's force is not that of a smooth equation within a step: its activation moves
    by a rule of its own (`filterexact`, to which `timeconst` of a position servo leads, a DC motor's current), is that
    after the step (`actearly`), or its control comes late, and with a jump.
    """
    if model.opt.integrator != RK4 or model.nhistory:
        return 1
    of = np.asarray(model.actuator_actnum) > 0
    own = np.isin(model.actuator_dyntype, _BY_THEMSELVES) | np.asarray(model.actuator_actearly, bool)
    return 1 if (of & own).any() else 4
