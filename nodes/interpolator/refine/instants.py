"""The instants between the coarse frames of a gap at which single pixels may be evaluated."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from evis.runtime.clock import subframe_stamps

ROWS, MOST = 1 << 23, 1 << 27
"""Pixels of all instants that are placed together, of which little is touched: as many as a window has, if it holds
several coarse intervals, and most."""

DEEPEST = 10
"""Most times that a coarse interval is halved."""


@dataclass(frozen=True)
class Instants:
    """Says how finely a gap is cut: K coarse intervals of 2^depth instants each, `windows` of which are worked on one
    after the other; per_window: coarse intervals of one. reached: whether that is fine enough."""

    coarse: int
    depth: int
    per_window: int
    reached: bool = True

    @property
    def count(self) -> int:
        """Gives the instants of a gap, coarse ones included."""
        return self.coarse << self.depth

    @property
    def inside(self) -> int:
        """Gives the instants within a coarse interval."""
        return (1 << self.depth) - 1

    @property
    def slots(self) -> int:
        """Gives the instants of a window, without the coarse ones."""
        return self.per_window * self.inside

    def windows(self) -> list[tuple[int, int]]:
        """Gives the coarse intervals of each window, first and last + 1."""
        return [(k, min(k + self.per_window, self.coarse)) for k in range(0, self.coarse, self.per_window)]

    def of_window(self, first: int) -> list[int]:
        """Gives the instant, counted from 1, of each slot of the window that begins with a coarse interval; those left
        over repeat the last one."""
        each = 1 << self.depth
        made = [k * each + j for k in range(first, first + self.per_window) for j in range(1, each)]
        return [min(i, self.count) for i in made]

    def stamps(self, t_a: int, t_b: int) -> np.ndarray:
        """Gives the times int64 [count] ns of all instants between two keyframes."""
        return subframe_stamps(t_a, t_b, self.count)


def instants_of(gap_ns: int, coarse: int, tolerance_ns: float, pixels: int, looks: int, cpu: bool) -> Instants:
    """Finds instants so close that a crossing between two of them is known to the tolerance, from their middle.

    pixels: of an instant, in all environments. looks: instants per coarse interval, at least, a power of two. cpu:
    whether the device is one.
    """
    wanted = max(0, math.ceil(math.log2(max(gap_ns / coarse / (2 * tolerance_ns), 1e-9))))
    least = looks.bit_length() - 1
    wanted = max(wanted, least) if wanted else 0
    room = max(1, (ROWS if cpu else MOST) // max(pixels, 1))
    depth = min(wanted, DEEPEST, max(least, int(math.log2(MOST // max(pixels, 1) + 1))))
    per_window = max(1, min(coarse, room // max((1 << depth) - 1, 1)))
    # As many in each window as in any other.
    return Instants(coarse, depth, -(-coarse // -(-coarse // per_window)), depth == wanted)
