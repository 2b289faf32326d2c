"""Offers many environments of a task in one simulation as Gymnasium's VectorEnv."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from evis.client.resets import seeds_of
from evis.env.batch import Batch, NotCopied
from evis.env.observation import Observed, row
from evis.env.picture import RENDER_MODE, is_drawn
from evis.env.saved import BatchState
from evis.env.task import Task
from evis.simulation.simulation import Simulation


@dataclass(frozen=True)
class VectorState:
    """Holds where environments are. ended: bool [E], those that begin anew before they go on."""

    batch: BatchState
    ended: np.ndarray


class EventVectorEnv(NotCopied, VectorEnv):
    """Steps E environments together; those that end are put back to their start alone.

    autoreset_mode: SAME_STEP: the step that ends an episode returns the observation of the next one's start, and the
    last one in info["final_obs"]. NEXT_STEP: the step after it ignores the action and returns that start, reward 0.
    DISABLED: `reset(options={"reset_mask": mask})`.
    """

    metadata: dict[str, Any] = {"render_modes": [RENDER_MODE]}

    def __init__(
        self,
        task: str | Task,
        num_envs: int = 1,
        *,
        render_mode: str | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        **options: Any,
    ) -> None:
        """Starts the simulation. options: as `evis.env.batch.Batch` takes them, and arguments of the launch file and
        the scene. Raises ValueError.
        """
        drawn = is_drawn(render_mode)
        modes = [mode.value for mode in AutoresetMode]
        if autoreset_mode not in (*AutoresetMode, *modes):
            raise ValueError(f"autoreset_mode is {autoreset_mode!r}; it must be {', '.join(modes[:-1])} or {modes[-1]}")
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self._batch = Batch(task, num_envs, picture=drawn, **options)
        self.num_envs = num_envs = self._batch.envs
        self.render_mode = render_mode
        rate = self._batch.rate
        self.metadata = {"render_modes": [RENDER_MODE], "render_fps": rate, "autoreset_mode": self.autoreset_mode}
        self.single_observation_space = self._batch.observation_space
        self.single_action_space = self._batch.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._ended = np.zeros(num_envs, bool)
        self._begun = False

    @property
    def simulation(self) -> Simulation:
        """Returns the simulation that is stepped."""
        return self._batch.simulation

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observed, dict[str, Any]]:
        """Begins an episode of each environment, or of those of options["reset_mask"], bool [E].

        seed: environment k gets seed + k; or a seed for each; without one, the next episode of the same seeds begins.
        Raises ValueError.
        """
        chosen = self._chosen(options or {})
        seeds = self._seeds(seed, chosen)
        single = operator.index(cast(Any, seed)) if seed is not None and _is_single(seed) else None
        super().reset(seed=single)
        if seeds is None and not self._begun:
            seeds = self.np_random.integers(2**31, size=self.num_envs)
        observed = self._batch.reset(chosen, seeds)
        self._begun = True
        self._ended[chosen] = False
        return observed, {}

    def _chosen(self, options: dict[str, Any]) -> np.ndarray:
        if "reset_mask" not in options:
            return np.arange(self.num_envs)
        mask = np.asarray(options["reset_mask"])
        if mask.shape != (self.num_envs,) or mask.dtype != bool or not mask.any():
            raise ValueError(f"reset_mask must be bool [{self.num_envs}] with a True in it")
        if not self._begun:
            raise ValueError("the first reset is of all environments; leave reset_mask out")
        return np.flatnonzero(mask)

    def _seeds(self, seed: int | Sequence[int | None] | None, chosen: np.ndarray) -> np.ndarray | None:
        """Gives a seed for each environment that is reset; raises ValueError before anything has happened."""
        if seed is None:
            return None
        if _is_single(seed):
            return np.array(seeds_of(seed, range(self.num_envs)), np.int64)[chosen]
        given = list(cast(Sequence[Any], seed))
        if len(given) != self.num_envs:
            raise ValueError(f"there are {len(given)} seeds for {self.num_envs} environments")
        if any(one is None for one in given):
            raise ValueError("seeds must be one number, one for each environment, or None for all")
        # In a list for a simulation -1 keeps a seed; here each has to be one.
        return np.array([seeds_of(one, [0])[0] for one in given], np.int64)[chosen]

    def step(self, actions: Any) -> tuple[Observed, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Applies the actions until the next keyframe; returns observations, rewards, terminated, truncated and info.

        Raises ValueError for an action outside the space, before the first reset, and behind a step or reset that was
        left in the middle, as by Ctrl-C or an error of the task.
        """
        if not self._begun:
            raise ValueError("nothing has begun; reset() first")
        if self.autoreset_mode is AutoresetMode.DISABLED and self._ended.any():
            env = int(np.argmax(self._ended))
            raise ValueError(f"environment {env} has ended; reset it with options={{'reset_mask': mask}} first")
        with self._batch.whole(ValueError):
            return self._stepped(actions)

    def _stepped(self, actions: Any) -> tuple[Observed, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        next_step = self.autoreset_mode is AutoresetMode.NEXT_STEP
        observed, reward, terminated, truncated, values = self._batch.step(actions, self._ended if next_step else None)
        info = {name: value for name, value in values.items()}
        info |= {f"_{name}": np.ones(self.num_envs, bool) for name in values}
        if next_step and (over := self._ended.copy()).any():
            observed = self._batch.reset(np.flatnonzero(over))
            reward, terminated, truncated = (
                np.where(over, 0, v).astype(v.dtype) for v in (reward, terminated, truncated)
            )
            info |= {f"_{name}": ~over for name in values}
        self._ended = terminated | truncated
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._ended.any():
            observed = self._begin_anew(observed, values, info)
            self._ended = np.zeros(self.num_envs, bool)
        return observed, reward, terminated, truncated, info

    def _begin_anew(self, observed: Observed, values: dict[str, np.ndarray], info: dict[str, Any]) -> Observed:
        """Starts those that have ended at once; their last observations go into `info`."""
        ended = self._ended
        last = np.full(self.num_envs, None, object)
        for env in np.flatnonzero(ended):
            last[env] = row(observed, int(env))
        info["final_obs"], info["_final_obs"] = last, ended.copy()
        info["final_info"] = {**values, **{f"_{name}": ended.copy() for name in values}}
        info["_final_info"] = ended.copy()
        info.update({f"_{name}": ~ended for name in values})
        return self._batch.reset(np.flatnonzero(ended))

    def state(self) -> VectorState:
        """Keeps where all environments are, so that `restore` goes on from here, as often as wanted.

        The same actions then give the same observations, rewards and ends as the first time. It can be restored in any
        environments that are made by the same arguments, in this process. Raises ValueError before the first reset.
        """
        return VectorState(self._batch.state(), self._ended.copy())

    def restore(self, state: VectorState) -> tuple[Observed, dict[str, Any]]:
        """Goes on from a `state`, whatever has happened since; returns what was observed there, as `reset` does.

        Raises ValueError for what is no state, or that of other environments; nothing has happened then.
        """
        if not isinstance(state, VectorState):
            raise ValueError(f"restore takes what state() gave, not {state!r:.60}")
        observed = self._batch.restore(state.batch)
        self._ended, self._begun = state.ended.copy(), True
        return observed, {}

    def render(self) -> tuple[np.ndarray, ...] | None:  # type: ignore[override]
        """Returns a picture of each environment, uint8 [H, W, 3]."""
        return None if self.render_mode is None else tuple(self._batch.paint(env) for env in range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:
        """Ends the simulation."""
        self._batch.close()


def _is_single(seed: Any) -> bool:
    """Tells whether a seed is one for all; what is no number is judged as one."""
    return np.ndim(seed) == 0
