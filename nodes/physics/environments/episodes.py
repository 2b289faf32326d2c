"""Counts the episodes of environments that begin anew at different times."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from msgs.own_time import CONFIGURED


class Episodes:
    """Holds the number of the episode that each of E environments is in."""

    def __init__(self, envs: int) -> None:
        """Begins with episode 0 of all."""
        self.numbers = np.zeros(envs, np.int32)
        self._seeded = np.zeros(envs, np.int32)
        """The episode in which each was given its seed: the number of its reset counts from there."""

    @property
    def since_seed(self) -> np.ndarray:
        """Counts the resets of each environment since it was given its seed, int32 [E]."""
        since: np.ndarray = self.numbers - self._seeded
        return since

    def begin(self, envs: Sequence[int], seeds: Sequence[int], again: bool) -> list[int]:
        """Begins an episode of environments, and gives the number of each one's reset since its seed.

        seeds: which each is given, CONFIGURED = it keeps its own. again: whether there was an episode before.
        """
        if again:
            self.numbers[list(envs)] += 1
        given = np.array(envs)[np.array(seeds) != CONFIGURED]
        self._seeded[given] = self.numbers[given]
        resets: list[int] = self.since_seed[list(envs)].tolist()
        return resets

    def begin_diverged(self, envs: Sequence[int]) -> str:
        """Begins the next episode of environments that have diverged; tells in words which it is."""
        self.numbers[list(envs)] += 1
        found = sorted(set(self.numbers[list(envs)].tolist()))
        which = f"{found[0]}" if len(found) == 1 else f"{found[0]} to {found[-1]}"
        return f"{'it starts' if len(envs) == 1 else 'each starts'} again as episode {which}"
