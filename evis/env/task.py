"""Describes a task: a scene, what is rewarded, what ends an episode, and what the agent sees."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from evis.env.observation import Observation
from evis.env.state import State

SMALL = {"width": 64, "height": 64, "keyframe_rate": 50.0, "upsampling": 1, "interpolator": "none"}
"""Arguments for an agent to learn from: small images, every keyframe straight to the sensor."""
Judge = Callable[[State], np.ndarray]
"""Computes one value for every environment [E]."""


class Task:
    """Defines a task for agents: the base of all tasks. For a task of one's own: a subclass, or functions of the state.

        Task("robot_arm", {"events": VoxelGrid(5)}, reward=lambda state: -state.pose("gripper")[:, 2])

    scene: what may stand after `evis launch`. observation: one, or several by name. arguments: of the launch file and
    the scene. seconds: when an episode is cut off; 0 = never.
    """

    def __init__(
        self,
        scene: str,
        observation: Observation | Mapping[str, Observation],
        *,
        reward: Judge | None = None,
        terminated: Judge | None = None,
        arguments: Mapping[str, Any] | None = None,
        seconds: float = 0.0,
    ) -> None:
        """Describes a task. Without `reward` nothing is rewarded, without `terminated` nothing ends an episode but its
        time."""
        self.scene, self.observation, self.seconds = scene, observation, seconds
        self.arguments = dict(arguments or {})
        self._reward, self._terminated = reward, terminated

    def reward(self, state: State) -> np.ndarray:
        """Computes the reward of the step, float [E]."""
        return np.zeros(len(state.seconds)) if self._reward is None else self._reward(state)

    def terminated(self, state: State) -> np.ndarray:
        """Says which episodes have come to their end by what happened, bool [E]."""
        return np.zeros(len(state.seconds), bool) if self._terminated is None else self._terminated(state)

    def state(self) -> Any:
        """Returns what the task keeps of earlier steps: nothing, unless a subclass keeps something."""
        return None

    def restore(self, state: Any) -> None:
        """Goes on from what `state` gave."""

    def info(self, state: State) -> Mapping[str, np.ndarray]:
        """Returns further values by name, each [E]; they go into `info`."""
        return {}
