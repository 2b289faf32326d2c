"""Measures steps per second of a pole seen by an event camera, beside Gymnasium's pole drawn as frames.

    evis bench environments [--quick]

Both are stepped in turn in one process, with random actions, so that a busy machine slows both alike. Gymnasium's
CartPole-v1 draws 600 x 400 pixels with pygame; ours is rendered, lit, at 64 x 64 and goes through the event sensor.
"""

from __future__ import annotations

import importlib.util
import time
from typing import Any

import gymnasium
import numpy as np

import evis.env
from bench import command

ROUNDS = 5
STEPS = 20
"""Steps of each in a round."""


def drawn(count: int) -> gymnasium.vector.VectorEnv | None:
    """Makes as many of Gymnasium's poles, seen as frames; None where pygame is not installed."""
    if importlib.util.find_spec("pygame") is None:
        return None
    make = lambda: gymnasium.wrappers.AddRenderObservation(gymnasium.make("CartPole-v1", render_mode="rgb_array"))
    return gymnasium.vector.SyncVectorEnv([make] * count, autoreset_mode="SameStep")


def seconds(env: gymnasium.vector.VectorEnv, steps: int) -> float:
    """Measures how long some steps of an environment take with random actions [s]."""
    actions = [env.action_space.sample() for _ in range(steps)]
    begun = time.perf_counter()
    for action in actions:
        env.step(action)
    return time.perf_counter() - begun


def compare(count: int, rounds: int, steps: int) -> dict[str, Any]:
    """Compares environments of both kinds, `count` of each; returns a row of the table."""
    ours = gymnasium.make_vec(
        "evis/CartPole-v0", num_envs=count, autoreset_mode="SameStep", observation=evis.env.CountImage()
    )
    other = drawn(count)
    both = [env for env in (ours, other) if env is not None]
    for env in both:
        env.reset(seed=0)
        seconds(env, 3)
    times = np.array([[seconds(env, steps) for env in both] for _ in range(rounds)])
    rates = count * steps / np.median(times, axis=0)
    for env in both:
        env.close()
    row: dict[str, Any] = {"environments": count, "events, 64 x 64 [steps/s]": round(float(rates[0]))}
    if other is not None:
        row["frames, 600 x 400 [steps/s]"] = round(float(rates[1]))
        row["ratio"] = round(float(np.median(times[:, 1] / times[:, 0])), 2)
    return row


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures 1 to 64 environments."""
    rounds, steps = (2, 5) if quick else (ROUNDS, STEPS)
    rows = [compare(count, rounds, steps) for count in ((1, 4) if quick else (1, 2, 4, 8, 16, 32, 64))]
    note = "steps of all environments together; ratio: events over frames, median of rounds in turn"
    if "ratio" not in rows[0]:
        note += "; no frames, for pygame is not installed: pip install 'evis[bench]'"
    section = {"title": "Steps per second of environments", "command": "evis bench environments"}
    return {"steps": {**section, "rows": rows, "note": note}}


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
