"""Defines the task of keeping a fast ball in the view of a camera that a pan-tilt head turns."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from evis.env.observations import TimeSurface
from evis.env.state import State
from evis.env.task import SMALL, Task
from evis.geometry import se3

HALF_VIEW = np.radians(25)
"""Half the camera's field of view."""


class PanTilt(Task):
    """Rewards every step with 1 for a ball in the middle of the view, 0 at its edge; out of view ends it, or 10 s."""

    def __init__(self) -> None:
        super().__init__("pan_tilt", TimeSurface(tau=0.05), arguments=SMALL, seconds=10.0)

    def reward(self, state: State) -> np.ndarray:
        """Implements Task.reward."""
        return np.clip(1.0 - np.abs(offset(state)).max(axis=1) / HALF_VIEW, 0.0, 1.0)

    def terminated(self, state: State) -> np.ndarray:
        """Implements Task.terminated."""
        return np.abs(offset(state)).max(axis=1) > HALF_VIEW

    def info(self, state: State) -> Mapping[str, np.ndarray]:
        """Gives the angle between the optical axis and the ball [rad]."""
        ahead, left, up = ball_before_head(state)
        return {"offset": np.arctan2(np.hypot(left, up), ahead)}


def ball_before_head(state: State) -> np.ndarray:
    """Computes how far the ball is ahead of the camera, to its left and above it, float64 [3, E] m."""
    head, ball = state.pose("head"), state.pose("ball")
    return se3.rotate(se3.conjugate(head[:, 3:]), ball[:, :3] - head[:, :3]).T


def offset(state: State) -> np.ndarray:
    """Computes how far the ball is to the left of the optical axis and above it, float64 [E, 2] rad."""
    ahead, left, up = ball_before_head(state)
    return np.stack((np.arctan2(left, ahead), np.arctan2(up, ahead)), axis=1)
