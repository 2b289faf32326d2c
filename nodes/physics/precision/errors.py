"""Estimates how far the bodies of a run are from where exact integration of its model would have them, as far as is
known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Kept = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Errors as they were: of position and of rotation, and how far the bodies extend."""


@dataclass(frozen=True)
class Estimate:
    """Holds the largest errors of one body: number of the body, position [m] and rotation [rad]."""

    body: int
    position: float
    rotation: float


class Errors:
    """Keeps the largest errors that each body of a run had at any keyframe."""

    def __init__(self) -> None:
        self._position = self._rotation = self._reach = np.zeros(0)
        self.erased: list[str] = []
        """What oscillates too fast for an integrator that erases it, so that no course shows it."""

    def take(self, position: np.ndarray, rotation: np.ndarray, reach: np.ndarray) -> None:
        """Takes the errors of all bodies at one time.

        position: float64 [bodies] m. rotation: [bodies] rad. reach: [bodies] m, how far they extend.
        """
        if not len(self._position):
            self._position, self._rotation = np.zeros(len(position)), np.zeros(len(position))
        self._position = np.maximum(self._position, position)
        self._rotation = np.maximum(self._rotation, rotation)
        self._reach = reach

    def snapshot(self) -> Kept:
        """Returns the present errors, for `restore`; nobody writes to these arrays."""
        return self._position, self._rotation, self._reach

    def clear(self) -> None:
        """Sets all errors back to zero."""
        self.restore((np.zeros(0), np.zeros(0), np.zeros(0)))

    def restore(self, kept: Kept) -> None:
        """Restores errors that `snapshot` has returned."""
        self._position, self._rotation, self._reach = kept

    def worst(self) -> Estimate | None:
        """Gives the errors of the body whose farthest point is furthest off; None where nothing is known."""
        if not len(self._position):
            return None
        body = int(np.argmax(self._position + 2 * np.sin(0.5 * self._rotation) * self._reach))
        return Estimate(body, float(self._position[body]), float(self._rotation[body]))
