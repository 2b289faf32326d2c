"""States of environments after steps that were taken in one batch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nodes.physics.dynamics.states import State


@dataclass
class SteppedStates:
    """Holds the states of n environments after each of S steps, as what stepped them left them.

    nearest: float64 [n] m, least distance of a contact in any of them. warnings: int [n, W], how often MuJoCo had
    warned of each of its warnings, after them. constrained: bool [n], whether anything was touched or limited at the
    start of the last step. part: computes the states of a slice of the environments, arrays [m, S, ...]. lost: bool
    [n], environments whose states are of no use.
    """

    nearest: np.ndarray
    warnings: np.ndarray
    constrained: np.ndarray
    part: Callable[[slice], State]
    lost: np.ndarray
