"""Groups environments whose worlds differ: a node makes one thing for all that have a world in common."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from evis.scene.worlds import Group

T = TypeVar("T")


@dataclass
class Part(Generic[T]):
    """Holds an object that several environments share.

    envs: int64 [n]; live: bool [n], those that it still stands for.
    """

    envs: np.ndarray
    made: T
    live: np.ndarray

    @property
    def inputs(self) -> np.ndarray:
        """Gives the environments int64 [n] whose inputs it takes: for one that has left, those of one that has not."""
        return np.where(self.live, self.envs, self.envs[self.live][0])


class Parts(Generic[T]):
    """Holds objects that several environments share, each of which may get another world.

    An environment whose world changes leaves its part, and the others of that go on in it as before, with all that it
    remembers of them. What it makes in the place of who has left is read by nobody.
    """

    def __init__(self, groups: Sequence[Group], make: Sequence[Callable[[], T]]) -> None:
        """groups: scenes, each with its environments, int64 ascending. make: makes what is for each group."""
        self.parts: list[Part[T]] = []
        self.change(groups, make)

    @classmethod
    def of_all(cls, made: T, envs: int) -> Parts[T]:
        """Makes a single part of all environments from an object that is made already."""
        parts: Parts[T] = cls((), ())
        parts.parts = [Part(np.arange(envs), made, np.ones(envs, bool))]
        return parts

    def change(self, groups: Sequence[Group], make: Sequence[Callable[[], T]]) -> list[T]:
        """Takes the environments of `groups` out of their parts, and gives them new ones, which it returns."""
        for _, envs in groups:
            for part in self.parts:
                part.live &= ~np.isin(part.envs, envs)
        self.parts = [part for part in self.parts if part.live.any()]
        fresh = [Part(envs, make_one(), np.ones(len(envs), bool)) for (_, envs), make_one in zip(groups, make)]
        self.parts += fresh
        return [part.made for part in fresh]

    @property
    def all(self) -> list[T]:
        """Lists the parts that there are."""
        return [part.made for part in self.parts]
