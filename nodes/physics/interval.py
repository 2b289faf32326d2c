"""What a physics engine gives for one step of the graph, and the sub-step grid that engines share."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np


@dataclass
class Contacts:
    """M contacts of all environments, ordered by environment; fields as in WorldState."""

    env: np.ndarray
    body: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    force: np.ndarray
    distance: np.ndarray


@dataclass
class Interval:
    """States from the previous stamp to the new one, or at one instant (S = 1).

    t int64 [S] ns; pose float64 [E, S, N, 7]; twist float64 [E, S, N, 6]; qpos [E, S, nq], qvel [E, S, nv] where asked
    for. faults: (environment, text) of each environment that diverged and was put back to its start. warnings: the
    same of what may be wrong without having diverged.
    """

    t: np.ndarray
    pose: np.ndarray
    twist: np.ndarray
    qpos: np.ndarray | None = None
    qvel: np.ndarray | None = None
    contacts: Contacts | None = None
    faults: list[tuple[int, str]] = field(default_factory=list)
    warnings: list[tuple[int, str]] = field(default_factory=list)


class Engine(Protocol):
    """Moves the bodies of a scene."""

    controls: int
    """Number of actuators."""

    def start(self) -> Interval:
        """The state at stamp 0, S = 1."""

    def advance(self, to_ns: int, controls: np.ndarray | None = None) -> Interval:
        """On to stamp `to_ns` [ns] under controls float64 [E, nu] (None: as before, zero at first)."""


def grid_inside(start_ns: int, end_ns: int, step_ns: int) -> np.ndarray:
    """Multiples of step_ns strictly between two stamps, int64."""
    return np.arange(start_ns // step_ns + 1, -(-end_ns // step_ns), dtype=np.int64) * step_ns
