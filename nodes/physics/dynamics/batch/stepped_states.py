"""Holds states of environments after steps that were taken in one batch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from nodes.physics.dynamics.states import State, twist_and_pose

PLACES = ("xpos", "xquat", "cvel", "subtree_com")
"""Fields that a step leaves as they were before it, as `twist_and_pose` takes them."""
JOINTS = ("qpos", "qvel")


@dataclass(eq=False)
class Records:
    """Holds fields of MuJoCo's states as they were recorded after each step.

    each: [n, S, ...] after each step, by name; of places of bodies before each step where `now`, [n, ...], has those
    after the last one. Both may be written again with later steps.
    """

    each: dict[str, np.ndarray]
    now: dict[str, np.ndarray] | None

    def states(self, model: Any, rows: np.ndarray | slice) -> State:
        """Computes the states [m, S, ...] after each step of some of the environments."""
        then = []
        for name in PLACES:
            values = np.array(self.each[name][rows])
            if self.now is not None:
                values[:, :-1] = values[:, 1:].copy()
                values[:, -1] = self.now[name][rows]
            then.append(values)
        twist, pose = twist_and_pose(model, *then)
        return {"pose": pose, "twist": twist} | {name: self.each[name][rows] for name in JOINTS}


@dataclass
class SteppedStates:
    """Holds the states of n environments after each of S steps, in the form that their stepper keeps them in.

    nearest: float64 [n] m, least distance of a contact in any of them. warnings: int [n, W], how often MuJoCo had
    warned of each of its warnings, after them. constrained: bool [n], whether anything was touched or limited at the
    start of the last step. part: computes the states of a slice of the environments, arrays [m, S, ...]. lost: bool
    [n], environments whose states are of no use. records, places: what they were recorded as by MuJoCo, and the rows
    [n] there; None of MuJoCo Warp.
    """

    nearest: np.ndarray
    warnings: np.ndarray
    constrained: np.ndarray
    part: Callable[[slice], State]
    lost: np.ndarray
    records: Records | None = None
    places: np.ndarray | None = None
