"""Finds which environments a reset names, and the seeds that it gives them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from evis.config.suggestions import environments_there
from msgs.own_time import CONFIGURED, LARGEST_SEED


class ResetRefused(ValueError):
    """Tells of a reset that cannot be, of which nothing has happened."""


def checked(
    envs: Sequence[int] | np.ndarray, seeds: Sequence[int] | np.ndarray, count: int
) -> tuple[list[int], list[int]]:
    """Gives the environments of a reset in order, and a seed for each, CONFIGURED where it keeps its own.

    envs: none = all `count`. seeds: one for each of envs, or none at all. Raises ValueError for an environment that is
    not there or is named twice, and for seeds that do not fit.
    """
    chosen = [int(e) for e in np.asarray(envs).reshape(-1)] or list(range(count))
    given = [int(s) for s in np.asarray(seeds).reshape(-1)] or [CONFIGURED] * len(chosen)
    for env in chosen:
        if not 0 <= env < count:
            raise ValueError(f"a reset names environment {env}; {environments_there(count)}")
        if chosen.count(env) > 1:
            raise ValueError(f"a reset names environment {env} twice")
    if len(given) != len(chosen):
        raise ValueError(f"a reset has {len(given)} seeds for {len(chosen)} environments; give one for each, or none")
    for env, seed in zip(chosen, given):
        if seed != CONFIGURED and not 0 <= seed <= LARGEST_SEED:
            raise ValueError(f"a reset has seed {seed} for environment {env}; seeds are 0 or more, -1 keeps its own")
    pairs = sorted(zip(chosen, given))
    return [env for env, _ in pairs], [seed for _, seed in pairs]
