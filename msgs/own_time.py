"""Defines own time: what messages carry of environments once one of them was reset by itself.

Time within an environment counts from its own reset. As long as all were reset together, as at the start of a run,
that is the time of the stamps, and messages carry none of this. Afterwards they carry `own`, int64 [E, 4], one row per
environment with the columns below.

The time of an event or a sub-frame is made in its environment's own time and published with `ORIGIN` added. Stamps are
rounded to nanoseconds, so what is published may lie 1 ns beside the stamps that all environments share.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from msgs.fields import array

STAMP, ORIGIN, SEED, NUMBER = range(4)
"""Columns of `own`: the own stamp [ns] of the message; the stamp [ns] at which the own time is 0; the seed that the
environment was given at a reset, CONFIGURED before; how often it has begun anew since it got that seed."""

CONFIGURED = -1
"""In SEED: environment e has the random numbers of each node's own seed + e, as at the start of the run."""

LARGEST_SEED = 2**63 - 1
"""That an environment may be given: SEED is a signed number of 64 bits."""


def own_rows() -> Any:
    """Declares the field `own` of a message."""
    return array("int64", "E 4", "own stamp, origin [ns], seed, number of the reset: see msgs.own_time", optional=True)


def rows_of_shared_time(episodes: np.ndarray, stamp_ns: int) -> np.ndarray:
    """Makes the rows of `own`, int64 [E, 4], of environments whose time is that of the stamps.

    episodes: int32 [E]. stamp_ns: of the message.
    """
    rows = np.zeros((len(episodes), 4), np.int64)
    rows[:, STAMP], rows[:, SEED], rows[:, NUMBER] = stamp_ns, CONFIGURED, episodes
    return rows


def equal_runs(own: np.ndarray) -> list[slice]:
    """Finds the longest runs of neighbouring environments that one engine can take together.

    own: int64 [E, 4]. Within a run the own stamp, the origin and the number of the reset are the same, and seeds go up
    by one or are all CONFIGURED.
    """
    step = np.diff(own, axis=0)
    same = (step[:, [STAMP, ORIGIN, NUMBER]] == 0).all(axis=1)
    given = own[:-1, SEED] != CONFIGURED
    same &= np.where(given, step[:, SEED] == 1, step[:, SEED] == 0)
    borders = [0, *(np.flatnonzero(~same) + 1).tolist(), len(own)]
    return [slice(a, b) for a, b in pairwise(borders)]
