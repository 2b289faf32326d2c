"""Says how an episode begins and when it is cut off: its seed and its last step."""

from __future__ import annotations

import numpy as np

from evis.env.observations import is_number

UNLIMITED = -1
"""What Gymnasium takes as max_episode_steps where nothing is to be cut off by it."""


def episode_seed(seed: int, episode: int) -> int:
    """Computes the seed of the simulation for an episode: the seed itself for the first, then others drawn from it."""
    if not episode:
        return seed
    return int(np.random.SeedSequence([seed, episode]).generate_state(1, np.uint64)[0] >> np.uint64(2))


def last_step(seconds: float, rate: float, most: int | None) -> int | None:
    """Computes the number of the step that an episode is cut off by, None = it never is.

    seconds: what an episode takes, 0 = without an end. rate: steps per second [Hz]. most: Gymnasium's
    max_episode_steps; the shorter of both holds. Raises ValueError.
    """
    if not is_number(seconds) or not 0 <= seconds < np.inf:
        raise ValueError(f"seconds is {seconds!r:.60}; an episode takes some time, or has no end with 0")
    whole = isinstance(most, int | np.integer) and not isinstance(most, bool)
    if most is not None and not (whole and (most >= 1 or most == UNLIMITED)):
        raise ValueError(
            f"max_episode_steps is {most!r:.60}; it must be a whole number, 1 or more, or {UNLIMITED} for no limit"
        )
    limits = [round(seconds * rate)] if seconds else []
    if most not in (None, UNLIMITED):
        limits.append(int(most or 0))
    return min(limits, default=None)
