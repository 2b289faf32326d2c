"""Offers one environment of a task as Gymnasium's Env."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from evis.client.resets import seeds_of
from evis.env.batch import Batch, NotCopied
from evis.env.observation import row
from evis.env.picture import RENDER_MODE, is_drawn
from evis.env.saved import BatchState
from evis.env.task import Task
from evis.simulation.simulation import Simulation


class EventEnv(NotCopied, gymnasium.Env):
    """Steps a simulation with an event camera, a keyframe at a time."""

    metadata: dict[str, Any] = {"render_modes": [RENDER_MODE]}

    def __init__(self, task: str | Task, *, render_mode: str | None = None, **options: Any) -> None:
        """Starts the simulation. options: as `evis.env.batch.Batch` takes them, and arguments of the launch file and
        the scene. Raises ValueError.
        """
        drawn = is_drawn(render_mode)
        self._batch = Batch(task, 1, picture=drawn, **options)
        self.render_mode = render_mode
        self.metadata = {"render_modes": [RENDER_MODE], "render_fps": self._batch.rate}
        self.observation_space = self._batch.observation_space
        self.action_space = self._batch.action_space
        self._begun = False

    @property
    def simulation(self) -> Simulation:
        """Returns the simulation that is stepped."""
        return self._batch.simulation

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begins an episode: that of the seed, or without one the next of the same seed."""
        if seed is not None:
            (seed,) = seeds_of(seed, [0])
        super().reset(seed=seed)
        if seed is None and not self._begun:
            seed = int(self.np_random.integers(2**31))
        observed = self._batch.reset(np.arange(1), None if seed is None else np.array([seed]))
        self._begun = True
        return row(observed, 0), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Applies the action until the next keyframe; returns observation, reward, terminated, truncated and info.

        Raises ValueError for an action that is not in the space, before the first reset, and behind a step or reset
        that was left in the middle, as by Ctrl-C or an error of the task.
        """
        if not self._begun:
            raise ValueError("nothing has begun; reset() first")
        given, expected = np.shape(action), self.action_space.shape
        if given != expected:
            raise ValueError(f"the action has shape {list(given)}; it must be {list(expected or ())}")
        observed, reward, terminated, truncated, info = self._batch.step(np.asarray(action)[None])
        about = {name: value[0] for name, value in info.items()}
        return row(observed, 0), float(reward[0]), bool(terminated[0]), bool(truncated[0]), about

    def state(self) -> BatchState:
        """Keeps where the environment is, so that `restore` goes on from here, as often as wanted.

        The same actions then give the same observations, rewards and ends as the first time. It can be restored in any
        environment that is made by the same arguments, in this process. Raises ValueError before the first reset.
        """
        return self._batch.state()

    def restore(self, state: BatchState) -> tuple[Any, dict[str, Any]]:
        """Goes on from a `state`, whatever has happened since; returns what was observed there, as `reset` does.

        Raises ValueError for what is no state, or that of another environment; nothing has happened then.
        """
        if not isinstance(state, BatchState):
            raise ValueError(f"restore takes what state() gave, not {state!r:.60}")
        observed = self._batch.restore(state)
        self._begun = True
        return row(observed, 0), {}

    def render(self) -> np.ndarray | None:  # type: ignore[override]
        """Returns the camera's picture with the events of the last step in it, uint8 [H, W, 3]."""
        return None if self.render_mode is None else self._batch.paint(0)

    def close(self) -> None:
        """Ends the simulation."""
        self._batch.close()
