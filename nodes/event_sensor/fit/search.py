"""Minimises least squares of few unknowns, where the function is a simulation: Levenberg and Marquardt's method."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

STEP = 0.04
"""Of an unknown, for the slopes: statistics of a simulation have steps of their own, which this must go beyond."""
TURNS, FIRST_TURNS = 12, 3
ENOUGH = 5e-3
"""Relative gain below which, two turns in a row, the search ends."""


@dataclass(frozen=True)
class Found:
    """Holds the unknowns [n], residuals [m] there, slopes [m, n] and the sum of the residuals' squares."""

    values: np.ndarray
    residuals: np.ndarray
    slopes: np.ndarray

    @property
    def cost(self) -> float:
        """Returns the sum of squares."""
        return float(self.residuals @ self.residuals)

    def deviations(self, least: float) -> np.ndarray:
        """Returns the standard deviations [n] of the unknowns, the residuals being as large as they turned out to be,
        or `least` if that is larger."""
        free = max(len(self.residuals) - len(self.values), 1)
        inverse = np.linalg.pinv(self.slopes.T @ self.slopes)
        return np.asarray(np.sqrt(np.maximum(np.diag(inverse), 0) * max(self.cost / free, least**2)))


Residuals = Callable[[np.ndarray], np.ndarray]
Slopes = Callable[[np.ndarray, np.ndarray], np.ndarray]


def least_squares(
    residuals: Residuals, starts: Sequence[np.ndarray], low: np.ndarray, high: np.ndarray, slopes: Slopes | None = None
) -> Found:
    """Searches unknowns [n] between low and high that make the sum of squares of residuals [m] least.

    starts: where it begins; after FIRST_TURNS from each the best one goes on. slopes: gives the slopes [m, n] at
    unknowns with these residuals; without it they are differences over STEP.
    """
    slopes = slopes or (lambda at, here: differences_over(residuals, at, here, range(len(at))))
    if len(starts) > 1:
        first = [_search(residuals, start, low, high, slopes, FIRST_TURNS) for start in starts]
        starts = [min(first, key=lambda found: found.cost).values]
    return _search(residuals, starts[0], low, high, slopes, TURNS)


def _search(
    residuals: Residuals, start: np.ndarray, low: np.ndarray, high: np.ndarray, slopes: Slopes, turns: int
) -> Found:
    at, damping = np.clip(start, low, high), 1e-2
    here = residuals(at)
    slope, idle = slopes(at, here), 0
    for _ in range(turns):
        before = float(here @ here)
        while True:
            square = slope.T @ slope
            step = np.linalg.lstsq(square + damping * np.diag(np.diag(square) + 1e-9), -slope.T @ here, rcond=None)[0]
            there = np.clip(at + np.clip(step, -0.5, 0.5), low, high)
            new = residuals(there)
            if float(new @ new) < before:
                at, here, damping = there, new, max(damping / 4, 1e-6)
                break
            damping *= 5
            if damping > 1e4:
                return Found(at, here, slope)
        slope = slopes(at, here)
        idle = idle + 1 if float(here @ here) > before * (1 - ENOUGH) else 0
        if idle == 2:
            break
    return Found(at, here, slope)


def differences_over(residuals: Residuals, at: np.ndarray, here: np.ndarray, which: range) -> np.ndarray:
    """Computes the slopes [m, len(which)] of the residuals, by a step of each of the unknowns `which`."""
    columns = []
    for i in which:
        there = at.copy()
        there[i] += STEP
        columns.append((residuals(there) - here) / STEP)
    return np.stack(columns, 1)
