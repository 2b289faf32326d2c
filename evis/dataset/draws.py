"""Draws where in its range an argument of a sequence lies: a pure function of what is drawn and of its number."""

from __future__ import annotations

import functools
import hashlib
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from evis.random_numbers import GOLDEN, mix, open_uniform

SAMPLINGS = ("random", "latin", "grid")
"""How arguments are drawn: each by itself, stratified over the sequences (Latin hypercube), or every combination."""
SCALES = ("linear", "log")
_PIECE = 400.0
"""Most events that are drawn by one number: e^-400 and what the sums of it come to lie within float64."""


def key_of(*names: Any) -> np.uint64:
    """Returns the key of a stream of random numbers, by what it is for."""
    text = "/".join(map(str, names)).encode()
    return np.uint64(int.from_bytes(hashlib.sha256(text).digest()[:8], "little"))


def uniform(key: np.uint64, n: int) -> float:
    """Returns the n-th number of a stream, in (0, 1)."""
    return float(open_uniform(bits_at(key, np.array([n], np.uint64)))[0])


def whole(key: np.uint64, n: int) -> int:
    """Returns the n-th whole number of a stream, in [0, 2^31)."""
    return int(bits_at(key, np.array([n], np.uint64))[0] >> np.uint64(33))


def poisson(key: np.uint64, mean: float) -> int:
    """Draws a number of events from Poisson's law, of which `mean` are expected.

    By inversion; a large number is a sum of those of equal pieces, whose least probabilities float64 can hold.
    """
    pieces = max(1, math.ceil(mean / _PIECE))
    share = mean / pieces
    likely = math.exp(-share) * np.cumprod(np.append(1.0, share / np.arange(1, math.ceil(share + 12 * _PIECE**0.5))))
    drawn = open_uniform(bits_at(key, np.arange(pieces, dtype=np.uint64)))
    return int(np.searchsorted(np.cumsum(likely), drawn, "right").sum())


def bits_at(key: np.uint64, n: np.ndarray) -> np.ndarray:
    """Hashes a stream's key with places uint64 in it: 64 random bits for each."""
    with np.errstate(over="ignore"):
        return mix(key + (n + np.uint64(1)) * GOLDEN)


@functools.lru_cache(maxsize=256)
def _order(key: int, count: int) -> np.ndarray:
    """A permutation of `count` strata."""
    return np.argsort(bits_at(np.uint64(key), np.arange(count, dtype=np.uint64)), kind="stable")


def stratified(seed: int, names: tuple[Any, ...], n: int, count: int) -> float:
    """Returns a number in (0, 1) such that of each `count` successive ones every stratum of 1 / count has one."""
    block, place = divmod(n, count)
    stratum = int(_order(int(key_of(seed, *names, "strata", block)), count)[place])
    return (stratum + uniform(key_of(seed, *names, "within"), n)) / count


@dataclass(frozen=True)
class Axis:
    """Describes the values that an argument takes: `choices`, or a range in every component.

    low, high: of each component, inclusive. whole: whole numbers only. vector: the value is a list. steps: values of
    each component in a grid, ends included; 0 = not given.
    """

    name: str
    choices: tuple[Any, ...] = ()
    low: tuple[float, ...] = ()
    high: tuple[float, ...] = ()
    whole: bool = False
    vector: bool = False
    log: bool = False
    steps: int = 0

    @property
    def components(self) -> int:
        """Returns the numbers that are drawn for one value."""
        return 1 if self.choices else len(self.low)

    @property
    def levels(self) -> int:
        """Returns the number of values in a grid; 0 for a range without steps."""
        return len(self.choices) if self.choices else self.steps**self.components

    def at(self, places: Sequence[float]) -> Any:
        """Returns the value at a place in [0, 1) of each component."""
        if self.choices:
            return self.choices[min(int(places[0] * len(self.choices)), len(self.choices) - 1)]
        return self._value([self._number(i, u) for i, u in enumerate(places)])

    def level(self, n: int) -> Any:
        """Returns the n-th value of the grid."""
        if self.choices:
            return self.choices[n]
        numbers = []
        for i in range(self.components):
            n, step = divmod(n, self.steps)
            part = step / (self.steps - 1) if self.steps > 1 else 0.5
            numbers.append(self._number(i, part, ends=True))
        return self._value(numbers)

    def twice(self) -> Any:
        """Returns a value that a component of the grid has more than once, or None."""
        if self.choices:
            return next((value for value in self.choices if self.choices.count(value) > 1), None)
        for component in range(self.components):
            values = [self._number(component, step / max(self.steps - 1, 1), ends=True) for step in range(self.steps)]
            if (again := next((b for a, b in itertools.pairwise(values) if a == b), None)) is not None:
                return again
        return None

    def _number(self, component: int, u: float, ends: bool = False) -> float:
        low, high = self.low[component], self.high[component]
        if self.whole and not ends:  # each stands for all numbers up to the next: rounded, both ends would be too rare
            if self.log:
                found = int(math.exp(math.log(low) + u * math.log((high + 1) / low)))
                return max(int(low), min(found, int(high)))
            return min(int(low) + int(u * (int(high) - int(low) + 1)), int(high))
        value = math.exp(math.log(low) + u * math.log(high / low)) if self.log else low + u * (high - low)
        value = min(max(value, low), high)
        return round(value) if self.whole else value

    def _value(self, numbers: list[float]) -> Any:
        return numbers if self.vector else numbers[0]


def draw(axes: Sequence[Axis], sampling: str, seed: int, scene: str, n: int, count: int) -> dict[str, Any]:
    """Draws the n-th set of arguments of a scene.

    Args:
        sampling: one of SAMPLINGS. seed: of the recipe. count: sets that a Latin hypercube stratifies.
    """
    if sampling == "grid":
        values = {}
        for axis in reversed(axes):  # the last one changes fastest
            n, level = divmod(n, axis.levels)
            values[axis.name] = axis.level(level)
        return {axis.name: values[axis.name] for axis in axes}
    found = {}
    for axis in axes:
        names = [(scene, axis.name, component) for component in range(axis.components)]
        if sampling == "latin":
            places = [stratified(seed, name, n, count) for name in names]
        else:
            places = [uniform(key_of(seed, *name), n) for name in names]
        found[axis.name] = axis.at(places)
    return found


def turn(n: int, start: float) -> float:
    """Returns the n-th point of the golden-ratio sequence in [0, 1), of which every stretch is spread evenly."""
    return (start + n * 0.6180339887498949) % 1.0
