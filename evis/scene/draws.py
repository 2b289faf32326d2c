"""Draws random values of a scene by laws, and keeps what was drawn.

A value is a function of the environment's seed and of the name of its place in the scene file, such as
`materials.wood.albedo[0]`. It is a hash of the two, so that no draw depends on which others there are or in which order
they are made.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from statistics import NormalDist
from typing import Any, Protocol

import numpy as np

from evis.random_numbers import GOLDEN, mix, open_uniform

_STANDARD = NormalDist()


class Law(Protocol):
    """Turns a number that is uniform in (0, 1) into a value."""

    def value(self, u: float) -> Any:
        """Computes the value that belongs to u."""

    def fixed(self) -> bool:
        """Returns True where every u gives the same value."""

    def words(self) -> str:
        """Describes the law."""


@dataclass(frozen=True)
class Uniform:
    """Gives numbers evenly from low to high; log: even in the logarithm; whole: whole numbers, both ends among them."""

    low: float
    high: float
    log: bool = False
    whole: bool = False

    def value(self, u: float) -> Any:
        """Computes the value that belongs to u."""
        if self.fixed():
            return int(self.low) if self.whole else self.low
        if self.whole:
            first, last = int(self.low), int(self.high)
            return min(first + int(u * (last - first + 1)), last)
        if self.log:
            drawn = self.low * math.exp(u * math.log(self.high / self.low))
            return min(max(drawn, self.low), self.high)
        return self.low + (self.high - self.low) * u

    def fixed(self) -> bool:
        """Returns True where both ends are one."""
        return self.low == self.high

    def words(self) -> str:
        """Describes the law."""
        return f"{self.low:g} to {self.high:g}{' by its logarithm' if self.log else ''}"


@dataclass(frozen=True)
class Choice:
    """Gives one of some values, each as often as it stands in the list."""

    values: tuple[Any, ...]

    def value(self, u: float) -> Any:
        """Computes the value that belongs to u."""
        return self.values[int(u * len(self.values))]

    def fixed(self) -> bool:
        """Returns True where all values are one."""
        return all(value == self.values[0] for value in self.values)

    def words(self) -> str:
        """Describes the law."""
        return "one of " + ", ".join(map(str, self.values))


@dataclass(frozen=True)
class Normal:
    """Gives numbers of a normal distribution, cut off at low and high: what lies beyond is never drawn."""

    mean: float
    sigma: float
    low: float = -math.inf
    high: float = math.inf

    def value(self, u: float) -> Any:
        """Computes the value that belongs to u by the inverse of the distribution function."""
        if self.fixed():
            return self.mean
        below, above = ((end - self.mean) / self.sigma for end in (self.low, self.high))
        if below > 0:  # in the upper tail the distribution function is too close to 1 to be told apart
            drawn = self.mean - self.sigma * _within(-above, -below, 1.0 - u)
        else:
            drawn = self.mean + self.sigma * _within(below, above, u)
        return min(max(drawn, self.low), self.high)

    def fixed(self) -> bool:
        """Returns True without any spread."""
        return self.sigma == 0

    def words(self) -> str:
        """Describes the law."""
        return f"{self.mean:g} with a standard deviation of {self.sigma:g}"


def _within(below: float, above: float, u: float) -> float:
    """The standard normal number between two ends that belongs to u."""
    first, last = (0.5 * math.erfc(-end / math.sqrt(2.0)) for end in (below, above))
    share = first + (last - first) * u
    return _STANDARD.inv_cdf(share) if 0.0 < share < 1.0 else (below if share <= 0.0 else above)


@dataclass(frozen=True)
class Drawn:
    """Holds one value that was drawn: where it stands, by which law, in which unit (`deg`, `rad` or none)."""

    place: str
    law: Law
    value: Any
    unit: str = ""


@dataclass
class Draws:
    """Draws the values of one environment's world and remembers them. made: by place, those that are random."""

    seed: int
    made: dict[str, Drawn] = field(default_factory=dict)

    def value(self, place: str, law: Law, unit: str = "") -> Any:
        """Draws the value of a place."""
        if law.fixed():
            return law.value(0.5)
        drawn = law.value(uniform(self.seed, place))
        self.made[place] = Drawn(place, law, drawn, unit)
        return drawn


def uniform(seed: int, place: str) -> float:
    """Computes the number in (0, 1) of a seed and a place."""
    name = int.from_bytes(hashlib.blake2b(place.encode(), digest_size=8).digest(), "little")
    stream = mix(np.array([seed], np.uint64) + GOLDEN)
    return float(open_uniform(mix((stream ^ np.uint64(name)) + GOLDEN))[0])


def would_draw(drawn: Iterable[Drawn], seed: int) -> bool:
    """Returns True where another seed gives every one of these values again.

    A world is made by its draws alone, and which ones it has depends on those before, so it is the same world then.
    """
    return all(one.law.value(uniform(seed, one.place)) == one.value for one in drawn)
