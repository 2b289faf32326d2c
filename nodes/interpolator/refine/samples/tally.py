"""Counts what is listed in a window: on the device, where kernels read the counts, and on the host, all at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from nodes.interpolator.refine.instants import DEEPEST

LISTS = DEEPEST + 2
"""Most lists of pixels of a window: the first one, and one for each time that an interval may be halved, but for the
last of which none is listed."""


@dataclass(frozen=True)
class Counts:
    """Holds the counts of a tally.

    transitions [bands]: changes from one surface to another. lists [LISTS, bands]: entries of each list. shaded: of
    them, those that no keyframe shows. made [LISTS + 1]: samples before each list was evaluated, and after the last
    one. swings [E]: see `Tally`.
    """

    transitions: np.ndarray
    lists: np.ndarray
    shaded: int
    made: np.ndarray
    swings: np.ndarray


class Tally:
    """Counts what the kernels of a window list, for each band of rows: int32 arrays that are parts of one.

    changing, transitions [bands]: pixels that show several surfaces, and how often these change; changed_spans [bands]:
    between how many probes they do. lists, unseen [LISTS] of [bands]: pixels of each list, and those of them that no
    keyframe shows. made [LISTS + 1]: samples before each list. swings [E]: how often in an environment what is painted
    goes up and down again from one instant to the next, where there is none between them.
    """

    def __init__(self, bands: int, envs: int, device: Any) -> None:
        self._bands, self._envs = bands, envs
        self._all = wp.zeros((2 * LISTS + 3) * bands + LISTS + 1 + envs, dtype=wp.int32, device=device)
        self.made, self.swings = self._all[: LISTS + 1], self._all[LISTS + 1 : LISTS + 1 + envs]
        rows = self._all[LISTS + 1 + envs :].reshape((-1, bands))
        self.changing, self.transitions, self.changed_spans = rows[0], rows[1], rows[2]
        self.lists, self.unseen = ([rows[first + n] for n in range(LISTS)] for first in (3, 3 + LISTS))

    def begin(self, made: int) -> None:
        """Begins a window, before which there are so many samples."""
        self._all.zero_()
        if made:
            self.made[:1].fill_(made)

    def read(self) -> Counts:
        """Reads the counts; on a GPU it waits for them."""
        counted = self._all.numpy()
        made, swings, rows = np.split(counted, [LISTS + 1, LISTS + 1 + self._envs])
        rows = rows.reshape(-1, self._bands)
        return Counts(rows[1], rows[3 : 3 + LISTS], int(rows[3 + LISTS :].sum()), made, swings)
