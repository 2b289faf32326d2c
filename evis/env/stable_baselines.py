"""Offers an EventVectorEnv to Stable-Baselines3: `PPO("MlpPolicy", StableBaselinesEnv(env))`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

try:
    from stable_baselines3.common.vec_env import VecEnv
except ModuleNotFoundError as error:
    need = "evis.env.stable_baselines needs Stable-Baselines3 and PyTorch: pip install 'evis[rl]'"
    raise ModuleNotFoundError(need, name=error.name) from None

from evis.env.vector import EventVectorEnv


class StableBaselinesEnv(VecEnv):
    """Presents an EventVectorEnv as a VecEnv of Stable-Baselines3; all environments stay in one simulation."""

    def __init__(self, env: EventVectorEnv) -> None:
        """Wraps an environment. env: with autoreset_mode=SAME_STEP, which Stable-Baselines3 works by. Raises ValueError
        for another."""
        if env.autoreset_mode is not AutoresetMode.SAME_STEP:
            raise ValueError(f"autoreset_mode is {env.autoreset_mode.value}; Stable-Baselines3 needs SameStep")
        self.env = env
        self.render_mode = env.render_mode
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def reset(self) -> Any:
        """Begins an episode of every environment, by the seeds of `seed` where there are such."""
        given = [seed for seed in self._seeds if seed is not None]
        observed, _ = self.env.reset(seed=given if len(given) == self.num_envs else None)
        self._reset_seeds()
        self._reset_options()
        return observed

    def step_async(self, actions: np.ndarray) -> None:
        """Keeps the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Steps all environments with the actions of `step_async`; returns observations, rewards, ends and infos."""
        observed, reward, terminated, truncated, info = self.env.step(self._actions)
        ended = terminated | truncated
        names = [name for name in info if not name.startswith(("_", "final_"))]
        about: list[dict[str, Any]] = [{name: info[name][env] for name in names} for env in range(self.num_envs)]
        for env in np.flatnonzero(ended):
            about[env]["terminal_observation"] = info["final_obs"][env]
            about[env]["TimeLimit.truncated"] = bool(truncated[env])
        return observed, reward.astype(np.float32), ended, about

    def close(self) -> None:
        """Ends the simulation."""
        self.env.close()

    def get_images(self) -> Sequence[np.ndarray | None]:
        """Returns the picture of every environment."""
        return list(self.env.render() or [None] * self.num_envs)

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Returns an attribute, which all environments share."""
        return [getattr(self.env, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Sets an attribute, which all environments share."""
        setattr(self.env, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Calls a method, which all environments share, once."""
        return [getattr(self.env, method_name)(*args, **kwargs)] * len(list(self._get_indices(indices)))

    def env_is_wrapped(self, wrapper_class: type[Any], indices: Any = None) -> list[bool]:
        """Says that no environment is wrapped."""
        return [False] * len(list(self._get_indices(indices)))
