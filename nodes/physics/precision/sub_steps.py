"""Takes sub-steps as short as a tolerance asks for, chosen by step doubling on saved states.

A step of the grid is taken in n parts, put back, and taken in 2 n parts. Of a method of order p what both leave differs
by 2^p - 1 times the error of the finer one. Of position, and of velocity over the time that its errors are looked at,
that may be no more than the step's share of the tolerance; else n is doubled. n depends on the environment's own state
alone, so that neither other environments nor threads change its course.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from evis.geometry import se3
from nodes.physics.dynamics.saved_state import STATE
from nodes.physics.precision.order import RK4, order_of
from nodes.physics.precision.tolerance import Tolerance
from nodes.physics.stiffness import modes

FINEST = 8
"""Of a step of the grid 2^FINEST parts are taken at most."""
HORIZON_S = 1.0
"""An error of velocity counts with what becomes of it in this time [s]."""
STABLE_IN = 6
"""RK4 takes the model's integrator's place where nothing grows in 2^-STABLE_IN of its step."""


def take_best_integrator(model: Any) -> None:
    """Gives the model RK4, which is exact soonest, unless something in it is too stiff for that.

    What makes RK4 one of order 1 is taken as the equation that it stands for: the step's exponential of an activation,
    and the activation after the step.
    """
    before = int(model.opt.integrator)
    model.opt.integrator = RK4
    if any(mode.grows(model.opt.timestep / 2**STABLE_IN) for mode in modes(model)):
        model.opt.integrator = before
        return
    model.actuator_dyntype[model.actuator_dyntype == mujoco.mjtDyn.mjDYN_FILTEREXACT] = mujoco.mjtDyn.mjDYN_FILTER
    model.actuator_actearly[:] = False


def _least_level(model: Any) -> int:
    """Finds the logarithm of the fewest parts in which no activation grows, which poses do not tell near its rest."""
    filters = [mode for mode in modes(model) if mode.activation]
    levels = range(FINEST - 1)
    fit = (k for k in levels if not any(mode.grows(model.opt.timestep / 2**k) for mode in filters))
    return next(fit, FINEST - 1)


class SubSteps:
    """Takes the steps of one environment. missed: how many of them were not exact enough in 2^FINEST parts."""

    def __init__(self, model: Any, tolerance: Tolerance) -> None:
        self._tolerance, self._smooth_order = tolerance, order_of(model)
        self._state = np.empty(mujoco.mj_stateSize(model, STATE))
        self._least = _least_level(model)
        self.begin()

    def begin(self) -> None:
        """Begins an episode, before its first step."""
        self.level = self._least
        self.missed = 0
        self.taken: list[int] = []
        """Parts of each step since this was emptied last."""

    def snapshot(self) -> tuple[int, int, int]:
        """Gives what `restore` takes to have the next steps taken again as they were."""
        return self.level, self.missed, len(self.taken)

    def restore(self, kept: tuple[int, int, int]) -> None:
        """Goes back to where `snapshot` was asked for."""
        self.level, self.missed, count = kept
        del self.taken[count:]

    def state(self) -> tuple[int, int]:
        """Gives what the next interval goes on from, where nobody asks for the parts of the last one any more."""
        return self.level, self.missed

    def go_on(self, state: tuple[int, int]) -> None:
        """Goes on from what `state` gave."""
        (self.level, self.missed), self.taken = state, []

    def step(self, model: Any, data: Any) -> None:
        """Takes a step of the grid; poses and velocities are those after it."""
        mujoco.mj_getState(model, data, self._state, STATE)
        counts = np.array(data.warning.number)
        coarse = self._try(model, data, 1 << self.level)
        while True:
            mujoco.mj_setState(model, data, self._state, STATE)
            data.warning.number[:] = counts
            fine = self._try(model, data, 2 << self.level)
            order = 1 if data.nefc else self._smooth_order
            off = self._off(coarse, fine, model.opt.timestep) / (2**order - 1)
            if off <= 1 or self.level == FINEST - 1:
                break
            self.level, coarse = self.level + 1, fine
        self.taken.append(2 << self.level)
        self.missed += not off <= 1
        if self.level > self._least and off * 2 ** (order + 1) < 1:
            self.level -= 1

    @staticmethod
    def _try(model: Any, data: Any, parts: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Takes a step in so many parts; returns positions, quaternions and velocities of all bodies."""
        whole = model.opt.timestep
        model.opt.timestep = whole / parts
        mujoco.mj_step(model, data, parts)
        model.opt.timestep = whole
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        return data.xpos[1:].copy(), data.xquat[1:].copy(), data.cvel[1:].copy()

    def _off(self, coarse: tuple[np.ndarray, ...], fine: tuple[np.ndarray, ...], dt: float) -> float:
        """Computes the largest difference of a body over the step's share of the tolerance."""
        shift = np.linalg.norm(fine[0] - coarse[0], axis=-1)
        turn = se3.multiply(se3.conjugate(se3.from_mujoco(coarse[1])), se3.from_mujoco(fine[1]))
        rate, drift = (HORIZON_S * np.linalg.norm((fine[2] - coarse[2])[:, part], axis=-1) for part in _PARTS)
        worst = np.maximum(np.maximum(shift, drift) / self._tolerance.position,
                           np.maximum(se3.angle(turn), rate) / self._tolerance.rotation)  # fmt: skip
        off = float(worst.max(initial=0.0)) / dt
        return off if np.isfinite(off) else np.inf


_PARTS = (slice(0, 3), slice(3, 6))
"""Angular and linear part of a spatial velocity."""
