"""Tells which bodies at rest MuJoCo leaves out of its steps, in models that ask for it by <flag sleep="enable"/>.

A tree of bodies falls asleep once it has been slower than `sleep_tolerance` for some steps, and wakes when something
touches it. How long it has been slow is no part of MuJoCo's saved states. So that a course depends on nothing else
than they tell, all trees are awake whenever steps may begin from a saved state: after a reset, where controls change
(for steps taken ahead are taken back there), and before and after steps that are taken again with checks.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from nodes.physics.dynamics.saved_state import SavedState

_SLEEP = int(mujoco.mjtEnableBit.mjENBL_SLEEP)
AWAKE = -1 - mujoco.mjMINAWAKE
"""What MuJoCo keeps of a tree that is awake and was not slow at its last step; it counts up to -1 and falls asleep."""


def sleeps(model: Any) -> bool:
    """Tells whether bodies of a model may sleep."""
    return bool(model.opt.enableflags & _SLEEP) and model.ntree > 0


def keep_awake(model: Any) -> None:
    """Lets no body of a model sleep."""
    model.opt.enableflags &= ~_SLEEP


def start_awake(model: Any) -> None:
    """Lets the bodies of a model that are meant to sleep from the start fall asleep as the others do."""
    policy = mujoco.mjtSleepPolicy
    model.tree_sleep_policy[model.tree_sleep_policy == int(policy.mjSLEEP_INIT)] = int(policy.mjSLEEP_ALLOWED)


def fell_asleep(model: Any, before: np.ndarray, now: np.ndarray) -> np.ndarray:
    """Tells which bodies [..., nbody] fell asleep between two of MuJoCo's `tree_asleep` [..., ntree].

    A rollout tells of them that they stand still one step earlier: it records velocities when MuJoCo has just put them
    to zero. So does whatever else takes steps, for an environment to move in a batch as alone.
    """
    fell = (before < 0) & (now >= 0)
    return fell[..., model.body_treeid] & (model.body_treeid >= 0)


def is_slow(model: Any, data: Any) -> bool:
    """Tells whether a body of an environment sleeps, or was slow enough to be about to."""
    return sleeps(model) and not np.all(data.tree_asleep == AWAKE)


def wake(model: Any, data: Any) -> None:
    """Wakes all bodies of an environment, whose state stays as it is.

    Nothing but a reset tells MuJoCo that a body is awake and was not slow.
    """
    if not is_slow(model, data):
        return
    saved = SavedState(model, data)
    mujoco.mj_resetData(model, data)
    saved.restore(model, data)
