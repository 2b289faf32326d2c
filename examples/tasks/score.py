"""Measures how well no action, random actions and the controllers of this folder do the tasks: a table over seeds.

python examples/tasks/score.py --seeds 20
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

import cart_pole
import gymnasium
import numpy as np
import pan_tilt
import pong

import evis.env

Act = Callable[[np.ndarray], np.ndarray]
"""From the events of a step, int64 [n, 4] (ns before its end, x, y, p), to controls."""
SIZE = (64, 64)


def controllers(task: str, k: np.ndarray, dt: float) -> tuple[Callable[[], None], Act]:
    """Makes the controller of a task: what begins an episode, and what acts."""
    if task == "CartPole":
        balancer = cart_pole.PoleBalancer(k, dt)
        return balancer.restart, lambda e: np.array([balancer.act(0, -e[:, 0], e[:, 1], e[:, 2])])
    if task == "PanTilt":
        follower = pan_tilt.BallFollower(k, SIZE, dt)
        return follower.restart, lambda e: follower.act(*e[:, 1:].T)
    returner = pong.BallReturner(k, SIZE, dt)
    return returner.restart, lambda e: np.array([returner.act(*e[:, 1:].T)])


def play(task: str, who: str, seeds: range, **options: Any) -> np.ndarray:
    """Plays one episode of each seed: return, length and sum of what the task counts, float64 [seeds, 3]."""
    env = gymnasium.make(
        f"evis/{task}-v0", observation=evis.env.RawEvents(8192), normalise=False, disable_env_checker=True, **options
    )
    camera = env.unwrapped.simulation.scene.camera("cam0")
    restart, act = controllers(task, camera.k, 1 / env.unwrapped.simulation.keyframe_rate)
    env.action_space.seed(seeds[0])
    rows = []
    for seed in seeds:
        events, _ = env.reset(seed=seed)
        restart()
        over, total, steps, returned = False, 0.0, 0, 0
        while not over:
            if who == "controller":
                action = act(events[events[:, 3] >= 0])
            else:
                action = env.action_space.sample() if who == "chance" else np.zeros(env.action_space.shape)
            events, reward, terminated, truncated, info = env.step(action)
            over, total, steps = terminated or truncated, total + reward, steps + 1
            returned += int(info.get("returned", 0))
        rows.append((total, steps, returned))
    env.close()
    return np.array(rows)


def main() -> None:
    """Runs the command."""
    parser = argparse.ArgumentParser(description="Measure the controllers.")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--tasks", nargs="+", choices=list(evis.env.TASKS), default=list(evis.env.TASKS))
    options = parser.parse_args()
    if options.seeds < 1:
        parser.error(f"--seeds is {options.seeds}; it must be 1 or more")
    print("| task | who | return | length [s] | whole episodes | balls returned |\n|---|---|---|---|---|---|")
    for task in options.tasks:
        for who in ("nobody", "chance", "controller"):
            found = play(task, who, range(1000, 1000 + options.seeds))
            total, length, _ = found.mean(axis=0)
            whole = f"{int((found[:, 1] >= 500).sum())} of {options.seeds}"
            missed = options.seeds - int((found[:, 1] >= 500).sum())
            hits = f"{found[:, 2].sum():.0f} of {found[:, 2].sum() + missed:.0f}" if task == "Pong" else ""
            print(f"| {task} | {who} | {total:.1f} | {length / 50:.2f} | {whole} | {hits} |", flush=True)


if __name__ == "__main__":
    main()
