"""Defines the task of returning a fast ball with a paddle."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from evis.env.observations import TimeSurface
from evis.env.state import State
from evis.env.task import SMALL, Task

MISSED_M = -0.05
"""Where a ball is past the paddle."""
NEAR_M = 0.5
"""A ball that turns round on this side of it was returned by the paddle."""


class Pong(Task):
    """Rewards a return with 1 and a miss with -1; a miss ends the episode, or 10 s."""

    def __init__(self) -> None:
        super().__init__("pong", TimeSurface(tau=0.1), arguments=SMALL, seconds=10.0)

    def reward(self, state: State) -> np.ndarray:
        """Implements Task.reward."""
        return returned(state).astype(float) - self.terminated(state)

    def terminated(self, state: State) -> np.ndarray:
        """Implements Task.terminated."""
        return state.pose("ball")[:, 0] < MISSED_M

    def info(self, state: State) -> Mapping[str, np.ndarray]:
        """Says whether the ball was returned in this step, and how far the paddle is from it across the table [m]."""
        across = state.pose("ball")[:, 1] - state.pose("paddle")[:, 1]
        return {"returned": returned(state), "across": across}


def returned(state: State) -> np.ndarray:
    """Says where the ball turned from the paddle within the step, bool [E]."""
    before, after = (state.twist("ball", at_start=start)[:, 0] for start in (True, False))
    return (before < 0) & (after > 0) & (state.pose("ball")[:, 0] < NEAR_M)
