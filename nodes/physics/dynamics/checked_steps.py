"""Takes the steps of one environment with a look at each state, where something in them may be wrong."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from nodes.physics.dynamics.followers import Followers
from nodes.physics.dynamics.sleep import fell_asleep, sleeps, wake
from nodes.physics.dynamics.states import State, snapshot
from nodes.physics.watchdog import Watchdog


@dataclass
class CheckedSteps:
    """Holds states, fault and notices of n steps of an environment.

    state: arrays [1, n, ...] after each step; from the one on at which it diverged, that state. fault: why it has
    diverged; None = it has not. notices: what else is to be told, one line each.
    """

    state: State
    fault: str | None
    notices: list[str]


def take_checked_steps(
    model: Any,
    data: Any,
    grid: Sequence[int],
    step: Callable[[Any, Any], None],
    dog: Watchdog,
    followers: Followers,
) -> CheckedSteps:
    """Takes a step from each time of `grid` [ns] by `step`, until the environment has diverged.

    followers: what follows bodies of the model. All bodies are awake before and after.
    """
    states, notices, fault = list[State](), list[str](), None
    wake(model, data)
    asleep = np.array(data.tree_asleep) if sleeps(model) else None
    for t in grid:
        # MuJoCo adds up its time in floating point; ours is exact.
        data.time = t * 1e-9
        step(model, data)
        # mj_step leaves poses and velocities of the state before the step.
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        if asleep is not None:
            # As it is told of steps that nobody checks: the velocity before the step in which something falls asleep.
            if states:
                states[-1]["twist"][0, : model.nbody - 1][fell_asleep(model, asleep, data.tree_asleep)[1:]] = 0.0
            asleep[:] = data.tree_asleep
        states.append(snapshot(model, [data], followers))
        pose, twist = (states[-1][name][0, : model.nbody - 1] for name in ("pose", "twist"))
        fault = dog.check(data, twist)
        if fault:
            break
        notices += dog.notices(data, pose, twist)
    wake(model, data)
    states += states[-1:] * (len(grid) - len(states))
    return CheckedSteps({n: np.concatenate([s[n] for s in states])[None] for n in states[0]}, fault, notices)
