"""Trains a policy from events with PPO of Stable-Baselines3, and draws its learning curve.

    pip install 'evis[rl,bench]'
    python examples/tasks/train.py CartPole --minutes 10 --out trained

The policy sees a time surface of events, put together into few numbers, and nothing else of the state.
"""

from __future__ import annotations

import argparse
import csv
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.spaces import Box
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv, VecFrameStack, VecMonitor, VecNormalize

import evis.env
from evis.env.observations import Moment, Setting
from evis.env.stable_baselines import StableBaselinesEnv


class Centroids(evis.env.Observation):
    """Shows where events are in bands of rows: an observation of one's own, of few numbers, float32 [bands, 3].

    Of each band the mean column of OFF and of ON events, from -1 to 1, and how many there were. Older events count less
    by exp(-steps / fade), so where a band is quiet its columns stay as they were.
    """

    def __init__(self, bands: int = 8, fade: float = 1.0) -> None:
        self.bands, self.keep = bands, float(np.exp(-1 / fade))

    def begin(self, setting: Setting) -> Box:
        """Implements Observation.begin."""
        self.size = setting.height, setting.width
        self.sums = np.zeros((setting.envs, self.bands, 2, 2))
        """Counts and summed columns of OFF and ON."""
        return Box(-np.inf, np.inf, (self.bands, 3), np.float32)

    def forget(self, envs: np.ndarray) -> None:
        """Implements Observation.forget."""
        self.sums[envs] = 0

    def values(self, moment: Moment) -> np.ndarray:
        """Implements Observation.values."""
        events, (height, width) = moment.step.events, self.size
        env = np.repeat(np.arange(len(self.sums)), np.diff(events.env_offsets))
        cell = (env * self.bands + events.y.astype(np.int64) * self.bands // height) * 2 + (events.p > 0)
        column = 2.0 * events.x / (width - 1) - 1
        fresh = np.stack([np.bincount(cell, w, self.sums.size // 2) for w in (None, column)], axis=-1)
        fresh = fresh.reshape(self.sums.shape)
        self.sums = self.sums * self.keep + fresh
        mean = self.sums[..., 1] / np.maximum(self.sums[..., 0], 1e-9)
        count = np.log1p(fresh[..., 0].sum(axis=-1, keepdims=True))
        return np.concatenate((mean, count), axis=-1).astype(np.float32)


OBSERVED = {
    "CartPole": Centroids(),
    "PanTilt": evis.env.CountImage(polarity="signed", pool=4),
    "Pong": evis.env.TimeSurface(tau=0.06, pool=4),
}
"""What the policy of each task sees."""
STACK = {"CartPole": 4, "PanTilt": 3, "Pong": 2}
"""How many steps of it."""


def environments(task: str, count: int, seed: int) -> VecEnv:
    """Makes the environments of a task in one simulation."""
    made = gymnasium.make_vec(f"evis/{task}-v0", num_envs=count, autoreset_mode="SameStep", observation=OBSERVED[task])
    made = VecMonitor(StableBaselinesEnv(made))
    made.seed(seed)
    return VecFrameStack(made, STACK[task], channels_order="first")


class Curve(BaseCallback):
    """Keeps the mean of the last 100 episodes after every rollout, and ends the training when its time is over.

    The time is that of the processor, which on an idle machine is that of the clock: one thread computes.
    """

    def __init__(self, minutes: float, path: Path) -> None:
        super().__init__()
        self.end, self.path, self.rows = 60 * minutes, path, []
        self.began, self.best = time.process_time(), -np.inf

    def left(self, _: float = 0) -> float:
        """Returns how much of the time is left, 1 to 0."""
        return max(0.0, 1 - (time.process_time() - self.began) / self.end)

    def _on_step(self) -> bool:
        return self.left() > 0

    def _on_rollout_end(self) -> None:
        if episodes := list(self.model.ep_info_buffer or []):
            mean = (float(np.mean([e[name] for e in episodes])) for name in ("r", "l"))
            self.rows.append((time.process_time() - self.began, self.num_timesteps, *mean))
            seconds, steps, total, length = self.rows[-1]
            print(f"{seconds:6.0f} s {steps:8d} steps  return {total:8.2f}  length {length:6.1f}", flush=True)
            if len(episodes) == 100 and self.rows[-1][2] > self.best:
                self.best = self.rows[-1][2]
                keep(self.model, self.path)
            with (self.path / "curve.csv").open("w", newline="") as file:
                csv.writer(file).writerows([("seconds", "steps", "return", "length"), *self.rows])


def keep(model: PPO, out: Path) -> None:
    """Writes the policy, and what its observations are normalised by."""
    model.save(out / "policy")
    model.get_vec_normalize_env().save(str(out / "normalise.pkl"))


def train(task: str, minutes: float, count: int, seed: int, out: Path) -> None:
    """Trains for so many minutes of the processor's time, and keeps the best policy."""
    torch.set_num_threads(1)
    envs = VecNormalize(environments(task, count, seed), gamma=0.98)
    policy = {"net_arch": [64, 64], "activation_fn": torch.nn.Tanh, "log_std_init": -0.5}
    curve = Curve(minutes, out)
    model = PPO(
        "MlpPolicy", envs, n_steps=2048 // count, batch_size=256, n_epochs=10, gamma=0.98, gae_lambda=0.95,
        learning_rate=lambda _: 1e-3 * curve.left(), target_kl=0.03, seed=seed, policy_kwargs=policy, device="cpu",
    )  # fmt: skip
    model.learn(10**9, callback=curve)
    envs.close()


def score(task: str, out: Path, episodes: int, seed: int) -> np.ndarray:
    """Plays episodes of other seeds without exploring, float64 [episodes, 2]: return and length of each."""
    envs = VecNormalize.load(str(out / "normalise.pkl"), environments(task, episodes, seed))
    envs.training = envs.norm_reward = False
    model = PPO.load(out / "policy", device="cpu")
    observed, found = envs.reset(), np.full((episodes, 2), np.nan)
    while np.isnan(found).any():
        observed, _, ended, info = envs.step(model.predict(observed, deterministic=True)[0])
        for env in np.flatnonzero(ended):
            if np.isnan(found[env, 0]):
                found[env] = info[env]["episode"]["r"], info[env]["episode"]["l"]
    envs.close()
    return found


def draw(curve: Path, out: Path, task: str) -> None:
    """Draws the curve of a training."""
    from matplotlib.figure import Figure

    with curve.open() as file:
        rows = np.array([[float(v) for v in row] for row in list(csv.reader(file))[1:]])
    figure = Figure((6, 3), layout="constrained")
    axes: Any = figure.subplots()
    axes.plot(rows[:, 0] / 60, rows[:, 2])
    axes.set(xlabel="minutes", ylabel="return, mean of 100 episodes", title=f"evis/{task}-v0, PPO from events")
    axes.grid(alpha=0.3)
    figure.savefig(out, dpi=110)


def main() -> None:
    """Runs the command."""
    parser = argparse.ArgumentParser(description="Train a policy from events.")
    parser.add_argument("task", choices=sorted(OBSERVED))
    parser.add_argument("--minutes", type=float, default=10)
    parser.add_argument("--envs", type=int, default=16)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("trained"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    train(options.task, options.minutes, options.envs, options.seed, options.out)
    found = score(options.task, options.out, 20, 10_000)
    text = "{} after {:g} min: return {:.2f} (least {:.2f}), length {:.0f} (least {:.0f}), of 20 other seeds"
    print(
        text.format(
            options.task, options.minutes, found[:, 0].mean(), found[:, 0].min(), found[:, 1].mean(), found[:, 1].min()
        )
    )
    draw(options.out / "curve.csv", options.out / "curve.png", options.task)


if __name__ == "__main__":
    main()
