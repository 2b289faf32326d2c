"""What the steps of an environment leave that were taken with those of others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

Judge = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""Takes qpos, qvel and twist [E, n, ...] and the least distances of contacts [E]; tells which are calm, bool [E]."""


@dataclass
class Strode:
    """Holds the states of an environment after each of n steps, float64 [n, ...].

    pose, twist: of all bodies but the world. nearest: least distance of a contact in any of them [m]. warnings: how
    often MuJoCo had warned of each of its warnings, after them. constrained: whether anything was touched or limited at
    the start of the last step. calm: whether there is nothing in these states to tell.
    """

    pose: np.ndarray
    twist: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    nearest: float
    warnings: np.ndarray
    constrained: bool
    calm: bool


def strides(
    arrays: Sequence[np.ndarray],
    nearest: np.ndarray,
    warnings: Sequence[np.ndarray],
    constrained: np.ndarray,
    judge: Judge,
) -> list[Strode]:
    """Takes environments apart. arrays: pose, twist, qpos and qvel, [E, n, ...] each; the others are [E]."""
    pose, twist, qpos, qvel = arrays
    calm = judge(qpos, qvel, twist, nearest)
    numbers = range(len(pose))
    return [
        Strode(pose[k], twist[k], qpos[k], qvel[k], float(nearest[k]), warnings[k], bool(constrained[k]), bool(calm[k]))
        for k in numbers
    ]
