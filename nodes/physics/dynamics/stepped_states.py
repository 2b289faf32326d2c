"""States of environments after steps that were taken in one batch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

CalmTest = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""(qpos, qvel, twist [E, n, ...], least contact distance [E]) -> bool [E]: environments whose states are far from every
limit, so that they need no check of their own."""


@dataclass
class SteppedStates:
    """Holds the states of an environment after each of n steps, float64 [n, ...].

    pose, twist: of all bodies but the world. nearest: least distance of a contact in any of them [m]. warnings: how
    often MuJoCo had warned of each of its warnings, after them. constrained: whether anything was touched or limited at
    the start of the last step. calm: whether all of them are far from every limit, see CalmTest.
    """

    pose: np.ndarray
    twist: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    nearest: float
    warnings: np.ndarray
    constrained: bool
    calm: bool


def by_environment(
    arrays: Sequence[np.ndarray],
    nearest: np.ndarray,
    warnings: Sequence[np.ndarray],
    constrained: np.ndarray,
    calm: CalmTest,
) -> list[SteppedStates]:
    """Splits a batch into the states of each environment.

    arrays: pose, twist, qpos and qvel, [E, n, ...] each. nearest, warnings, constrained: [E], as of SteppedStates.
    """
    pose, twist, qpos, qvel = arrays
    all_calm = calm(qpos, qvel, twist, nearest)
    rows = zip(pose, twist, qpos, qvel, nearest.tolist(), warnings, constrained.tolist(), all_calm.tolist())
    return [SteppedStates(*row) for row in rows]
