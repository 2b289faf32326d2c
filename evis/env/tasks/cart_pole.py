"""Defines the task of keeping a pole upright that only an event camera sees."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from evis.env.observations import TimeSurface
from evis.env.state import State
from evis.env.task import SMALL, Task

TRACK_M = 0.85
"""How far the cart may go from the middle: as far as the camera sees it."""
FALLEN = np.radians(15)


class CartPole(Task):
    """Asks the agent to keep the pole within 15 degrees of upright and the cart in view, for 10 s.

    A step is worth 1 with the pole upright in the middle, and falls to 0 where both are at their limits.
    """

    def __init__(self) -> None:
        super().__init__("cart_pole", TimeSurface(tau=0.1), arguments=SMALL, seconds=10.0)

    def reward(self, state: State) -> np.ndarray:
        """Implements Task.reward."""
        off = np.abs(lean(state)) / FALLEN + np.abs(state.pose("cart")[:, 0]) / TRACK_M
        return np.clip(1.0 - off / 2, 0.0, 1.0)

    def terminated(self, state: State) -> np.ndarray:
        """Implements Task.terminated."""
        return (np.abs(lean(state)) > FALLEN) | (np.abs(state.pose("cart")[:, 0]) > TRACK_M)

    def info(self, state: State) -> Mapping[str, np.ndarray]:
        """Gives the pole's angle [rad] and the cart's place [m]."""
        return {"angle": lean(state), "place": state.pose("cart")[:, 0].copy()}


def lean(state: State) -> np.ndarray:
    """Computes the pole's angle to the right of upright, float64 [E] rad."""
    q = state.pose("pole")[:, 3:]
    return 2 * np.arctan2(q[:, 1], q[:, 3])
