"""Saves the state of an environment, so that it can be put back."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

STATE = mujoco.mjtState.mjSTATE_INTEGRATION
"""All that the course of an environment depends on, in MuJoCo's words."""


class SavedState:
    """Holds a copy of an environment's state, so that its steps can be taken again."""

    def __init__(self, model: Any, data: Any) -> None:
        self._state = np.empty(mujoco.mj_stateSize(model, STATE))
        mujoco.mj_getState(model, data, self._state, STATE)
        self._counts = np.array(data.warning.number)

    @classmethod
    def of(cls, state: np.ndarray, counts: np.ndarray) -> SavedState:
        """Makes it of copies of MuJoCo's state, float64 [mj_stateSize], and of the counts of its warnings."""
        saved = cls.__new__(cls)
        saved._state, saved._counts = np.array(state), np.array(counts)
        return saved

    def restore(self, model: Any, data: Any) -> None:
        """Writes the state back into the environment's MjData, and how often MuJoCo had warned."""
        mujoco.mj_setState(model, data, self._state, STATE)
        data.warning.number[:] = self._counts
