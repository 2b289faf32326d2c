"""Holds states of environments after steps that were taken in one batch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nodes.physics.dynamics.states import State


@dataclass
class Records:
    """Holds fields of MuJoCo's states as they were recorded after each step.

    each: [n, S, ...] after each step, by name; of places of bodies before each step where `now`, [n, ...], has those
    after the last one.
    """

    each: dict[str, np.ndarray]
    now: dict[str, np.ndarray] | None


@dataclass
class SteppedStates:
    """Holds the states of n environments after each of S steps, as what stepped them left them.

    nearest: float64 [n] m, least distance of a contact in any of them. warnings: int [n, W], how often MuJoCo had
    warned of each of its warnings, after them. constrained: bool [n], whether anything was touched or limited at the
    start of the last step. part: computes the states of a slice of the environments, arrays [m, S, ...]. lost: bool
    [n], environments whose states are of no use. records, places: what they were recorded as by MuJoCo's threads, and
    the rows [n] there, None elsewhere.
    """

    nearest: np.ndarray
    warnings: np.ndarray
    constrained: np.ndarray
    part: Callable[[slice], State]
    lost: np.ndarray
    records: Records | None = None
    places: np.ndarray | None = None
