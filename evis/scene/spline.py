"""Computes smooth curves through given values at given times, with exact derivatives."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np


def apart(times: np.ndarray) -> bool:
    """Tells whether times [K] s ascend, each in a nanosecond of its own: of closer ones nothing shows what lies between
    them, and in the end their rates are beyond float64."""
    return bool((np.diff(np.rint(np.asarray(times, np.float64) * 1e9)) > 0).all())


class Spline:
    """Interpolates `values` [K, D] at `times` [K] s, ascending, by a cubic spline: twice continuously differentiable.

    loop=False: it starts with `start_rate` and ends with `end_rate` ([D] per second, zero by default), and goes on at
    those rates before the first and after the last time. loop=True: it repeats with the period times[-1] - times[0],
    and every lap adds values[-1] - values[0], so that an angle may go round. Each piece is a cubic in Hermite form
    whose slopes make the second derivative continuous (de Boor, A Practical Guide to Splines, 1978, ch. IV).
    """

    def __init__(
        self,
        times: np.ndarray,
        values: np.ndarray,
        loop: bool = False,
        start_rate: np.ndarray | None = None,
        end_rate: np.ndarray | None = None,
    ) -> None:
        self.times, self.loop = np.asarray(times, np.float64), loop
        self.values = np.asarray(values, np.float64).reshape(len(self.times), -1)
        rest = np.zeros(self.values.shape[1])
        start, end = (rest if rate is None else rate for rate in (start_rate, end_rate))
        self.rates = _slopes(self.times, self.values, loop, start, end)

    def __call__(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values and their derivatives, both [S, D], at times [S] s."""
        t = np.asarray(t, np.float64)
        inside, laps, k, u, h, (a, c, d) = self._pieces(t)
        value = self.values[k] + u * (a + u * (c + u * d)) + laps[:, None] * (self.values[-1] - self.values[0])
        rate = (a + u * (2 * c + 3 * u * d)) / h
        if not self.loop:
            value = value + (t - inside)[:, None] * rate
        return value, rate

    def bend(self, t: np.ndarray) -> np.ndarray:
        """Computes the second derivatives [S, D] at times [S] s; 0 where it goes on at its end's rate."""
        t = np.asarray(t, np.float64)
        inside, _, _, u, h, (_, c, d) = self._pieces(t)
        beyond = np.zeros(len(t), bool) if self.loop else inside != t
        return np.where(beyond[:, None], 0.0, (2 * c + 6 * u * d) / h**2)

    def _pieces(self, t: np.ndarray) -> tuple[Any, ...]:
        """Times within, laps gone, and of the pieces they lie in: number, place u in [0, 1], length, coefficients."""
        first, last = self.times[0], self.times[-1]
        laps = np.floor((t - first) / (last - first)) if self.loop else np.zeros(len(t))
        # Not np.clip, which takes longer than all the rest of a few times.
        inside = np.minimum(np.maximum(t - laps * (last - first), first), last)
        k = np.minimum(np.maximum(np.searchsorted(self.times, inside, side="right") - 1, 0), len(self.times) - 2)
        h = (self.times[k + 1] - self.times[k])[:, None]
        u = (inside - self.times[k])[:, None] / h
        rise = self.values[k + 1] - self.values[k]
        a, b = h * self.rates[k], h * self.rates[k + 1]
        return inside, laps, k, u, h, (a, 3 * rise - 2 * a - b, a + b - 2 * rise)


class Splines:
    """Interpolates the same number of values of each of B splines, all with the same times and loop: [B, S, D] where
    one gives [S, D], bit by bit the same."""

    def __init__(self, splines: Sequence[Spline]) -> None:
        first = splines[0]
        self.times, self.loop, self._count = first.times, first.loop, len(splines)
        self._joined = copy.copy(first)
        self._joined.values = np.hstack([spline.values for spline in splines])
        self._joined.rates = np.hstack([spline.rates for spline in splines])

    def __call__(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values and their derivatives, both [B, S, D], at times [S] s."""
        value, rate = self._joined(t)
        return self._apart(value), self._apart(rate)

    def bend(self, t: np.ndarray) -> np.ndarray:
        """Computes the second derivatives [B, S, D] at times [S] s, as `Spline.bend` does."""
        return self._apart(self._joined.bend(t))

    def _apart(self, values: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(np.swapaxes(values.reshape(len(values), self._count, -1), 0, 1))


def _slopes(t: np.ndarray, x: np.ndarray, loop: bool, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Derivatives [K, D] at the times: the second derivatives of neighbouring pieces agree."""
    h = np.diff(t)
    secant = np.diff(x, axis=0) / h[:, None]
    if not loop:
        return _clamped(h, secant, start, end)
    n = len(t)
    matrix, right = np.zeros((n, n)), np.zeros_like(x)
    for i in range(1, n - 1):
        matrix[i, i - 1 : i + 2] = 1 / h[i - 1], 2 / h[i - 1] + 2 / h[i], 1 / h[i]
        right[i] = 3 * (secant[i - 1] / h[i - 1] + secant[i] / h[i])
    # The last piece is followed by the first one; the slopes at both ends are the same.
    matrix[0, 0] += 2 / h[0] + 2 / h[-1]
    matrix[0, 1] += 1 / h[0]
    matrix[0, -2] += 1 / h[-1]
    right[0] = 3 * (secant[-1] / h[-1] + secant[0] / h[0])
    matrix[-1, 0], matrix[-1, -1] = 1.0, -1.0
    return np.linalg.solve(matrix, right)


def _clamped(h: np.ndarray, secant: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Computes the slopes with those at both ends given, by elimination along the diagonal (Thomas): a file may have a
    hundred thousand."""
    near, far = 1 / h[:-1], 1 / h[1:]
    diagonal, right = 2 * (near + far), 3 * (secant[:-1] * near[:, None] + secant[1:] * far[:, None])
    slopes = np.empty((len(h) + 1, secant.shape[1]))
    slopes[0], slopes[-1] = start, end
    above, rest = np.zeros(len(h)), slopes[0]
    for i in range(len(near)):
        pivot = diagonal[i] - near[i] * above[i]
        above[i + 1] = far[i] / pivot
        rest = slopes[i + 1] = (right[i] - near[i] * rest) / pivot
    for i in range(len(near), 0, -1):
        slopes[i] -= above[i] * slopes[i + 1]
    return slopes
