"""Trains a policy from events with PPO of Stable-Baselines3, and draws its learning curve.

    pip install 'evis[rl,bench]'
    python examples/tasks/train.py CartPole --minutes 10 --out trained

The policy sees few numbers made of events, and what it did itself, and nothing else of the state.
"""

from __future__ import annotations

import argparse
import csv
import time
from pathlib import Path
from typing import Any

import numpy as np

try:
    import gymnasium
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper, VecFrameStack, VecMonitor, VecNormalize
except ModuleNotFoundError as error:
    raise SystemExit(f"train.py: {error}; pip install 'evis[rl,bench]' brings it") from None
from observed import Centroids, Mover

import evis.env
from evis.env.stable_baselines import StableBaselinesEnv

SEEN: dict[str, dict[str, evis.env.Observation]] = {
    "CartPole": {"events": Centroids()},
    "PanTilt": {"events": Mover(least=5), "did": evis.env.LastAction()},
    "Pong": {"events": Mover(least=2, bottom=0.7), "did": evis.env.LastAction()},
}
"""What the policy of each task sees."""
STEPS = {"CartPole": 4, "PanTilt": 4, "Pong": 4}
"""How many steps of it."""
ROLLOUT = {"CartPole": 2048, "PanTilt": 512, "Pong": 2048}
"""Steps of all environments between two updates of the policy: few where episodes are short and say much."""
NOISE = {"CartPole": -0.5, "PanTilt": -1.2, "Pong": -1.0}
"""Natural logarithm of the standard deviation by which the policy explores at first, of actions from -1 to 1."""


class Hint(VecEnvWrapper):
    """Adds a small reward for being level with the ball to every step, while a policy is trained at Pong.

    A return or a miss comes once in 65 steps, and says little about what led to it.
    """

    def reset(self) -> Any:
        """Implements VecEnv.reset."""
        return self.venv.reset()

    def step_wait(self) -> Any:
        """Implements VecEnv.step_wait."""
        observed, reward, ended, about = self.venv.step_wait()
        off = np.array([one["across"] for one in about])
        return observed, reward + 0.05 * np.exp(-((off / 0.2) ** 2)).astype(np.float32), ended, about


class Increments(VecEnvWrapper):
    """Takes actions for changes of the actuators' rates, of at most half their range, so that not acting keeps a rate.

    That is the integral part of a controller, which a policy without a memory would have to learn to a hair.
    """

    def reset(self) -> Any:
        """Implements VecEnv.reset."""
        self.rates = np.zeros((self.num_envs, *self.action_space.shape), np.float32)
        return self.venv.reset()

    def step_async(self, actions: np.ndarray) -> None:
        """Implements VecEnv.step_async."""
        self.rates = np.clip(self.rates + 0.5 * actions, -1, 1)
        self.venv.step_async(self.rates)

    def step_wait(self) -> Any:
        """Implements VecEnv.step_wait."""
        observed, reward, ended, about = self.venv.step_wait()
        self.rates[ended] = 0
        return observed, reward, ended, about


def environments(task: str, count: int, seed: int, *, hint: bool = False) -> VecEnv:
    """Makes the environments of a task in one simulation."""
    made = gymnasium.make_vec(f"evis/{task}-v0", num_envs=count, autoreset_mode="SameStep", observation=SEEN[task])
    made = VecMonitor(StableBaselinesEnv(made))
    made.seed(seed)
    if task == "PanTilt":
        made = Increments(made)
    if hint and task == "Pong":
        made = Hint(made)
    return VecFrameStack(made, STEPS[task], channels_order="first")


class Curve(BaseCallback):
    """Keeps the mean of the last 100 episodes after every rollout, and ends the training when its time is over.

    The time is that of the processor, which on an idle machine is that of the clock: one thread computes.
    """

    def __init__(self, minutes: float, path: Path) -> None:
        super().__init__()
        self.end, self.path, self.rows = 60 * minutes, path, []
        self.began, self.best = time.process_time(), -np.inf
        self._write()  # a curve of an earlier training would be taken for this one's

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
            self._write()

    def _write(self) -> None:
        with (self.path / "curve.csv").open("w", newline="") as file:
            csv.writer(file).writerows([("seconds", "steps", "return", "length"), *self.rows])


def keep(model: PPO, out: Path) -> None:
    """Writes the policy, and what its observations are normalised by."""
    model.save(out / "policy")
    model.get_vec_normalize_env().save(str(out / "normalise.pkl"))


def train(task: str, minutes: float, count: int, seed: int, out: Path) -> None:
    """Trains for so many minutes of the processor's time, and keeps the best policy."""
    torch.set_num_threads(1)
    envs = VecNormalize(environments(task, count, seed, hint=True), gamma=0.98)
    policy = {"net_arch": [64, 64], "activation_fn": torch.nn.Tanh, "log_std_init": NOISE[task]}
    curve = Curve(minutes, out)
    rollout = ROLLOUT[task]
    model = PPO(
        "MultiInputPolicy", envs, n_steps=rollout // count, batch_size=min(256, rollout // 4), n_epochs=10, gamma=0.98,
        gae_lambda=0.95, learning_rate=lambda _: 1e-3 * curve.left(), target_kl=0.03, seed=seed, policy_kwargs=policy,
        device="cpu",
    )  # fmt: skip
    model.learn(10**9, callback=curve)
    if curve.best == -np.inf:  # too short for a hundred episodes
        keep(model, out)
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


def draw(curves: dict[str, Path], out: Path) -> None:
    """Draws the curves of trainings side by side, by task."""
    from matplotlib.figure import Figure

    figure = Figure((4 * len(curves) + 1, 3), layout="constrained")
    for axes, (task, path) in zip(np.atleast_1d(figure.subplots(1, len(curves))), curves.items()):
        with path.open() as file:
            rows = np.array([[float(v) for v in row] for row in list(csv.reader(file))[1:]]).reshape(-1, 4)
        axes.plot(rows[:, 0] / 60, rows[:, 2])
        axes.set(xlabel="minutes", title=f"evis/{task}-v0")
        axes.grid(alpha=0.3)
    figure.supylabel("return, mean of 100 episodes", fontsize="medium")
    figure.savefig(out, dpi=110)


def main() -> None:
    """Runs the command."""
    parser = argparse.ArgumentParser(description="Train a policy from events.")
    parser.add_argument("task", choices=sorted(SEEN))
    parser.add_argument("--minutes", type=float, default=10)
    parser.add_argument("--envs", type=int, default=16)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("trained"))
    options = parser.parse_args()
    if not 0 < options.minutes < np.inf:
        parser.error(f"--minutes is {options.minutes:g}; it must be a number above 0")
    if not 1 <= options.envs <= ROLLOUT[options.task]:
        parser.error(f"--envs is {options.envs}; it must be from 1 to {ROLLOUT[options.task]}")
    if options.seed < 0:
        parser.error(f"--seed is {options.seed}; it must be 0 or more")
    options.out.mkdir(parents=True, exist_ok=True)
    train(options.task, options.minutes, options.envs, options.seed, options.out)
    found = score(options.task, options.out, 20, 10_000)
    text = "{} after {:g} min: return {:.2f} (least {:.2f}), length {:.0f} (least {:.0f}), of 20 other seeds"
    print(
        text.format(
            options.task, options.minutes, found[:, 0].mean(), found[:, 0].min(), found[:, 1].mean(), found[:, 1].min()
        )
    )
    draw({options.task: options.out / "curve.csv"}, options.out / "curve.png")


if __name__ == "__main__":
    main()
