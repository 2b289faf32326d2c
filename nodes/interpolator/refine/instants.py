"""Chooses the instants between the coarse frames of a gap at which single pixels may be evaluated."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from evis.runtime.clock import subframe_stamps
from evis.scene.sampling import FINEST

ROWS, MOST = 1 << 23, 1 << 27
"""Most pixels of all slots of a window: on a CPU where a window has several coarse intervals, and where time_tolerance
alone asks for them."""
INDEXED = (1 << 31) - 1
"""Most in any case, for they are counted in int32."""

ROUNDED = 1e-6
"""Halvings by which gaps of one rate may differ."""
DEEPEST = FINEST.bit_length() - 1
"""Most times that a coarse interval is halved."""
LOOKS, LEAST_LOOKS = 32, 4
"""Instants per gap and per coarse interval, at least."""


@dataclass(frozen=True)
class Instants:
    """Describes how finely a gap is divided.

    coarse: K coarse intervals, each divided into 2^depth by the instants inside it, at least LEAST_LOOKS where it is
    divided at all. per_window: coarse intervals that are worked on at once. reached: whether the instants are as close
    as the tolerance of time asks for.
    """

    coarse: int
    depth: int
    per_window: int
    reached: bool = True

    @property
    def count(self) -> int:
        """Counts the instants of a gap, with the ends of coarse intervals."""
        return self.coarse << self.depth

    @property
    def inside(self) -> int:
        """Counts the instants inside a coarse interval, without its ends."""
        return (1 << self.depth) - 1

    @property
    def slots(self) -> int:
        """Counts the instants of a window, without the ends of coarse intervals."""
        return self.per_window * self.inside

    def windows(self) -> list[tuple[int, int]]:
        """Gives the coarse intervals of each window, first and last + 1."""
        return [(k, min(k + self.per_window, self.coarse)) for k in range(0, self.coarse, self.per_window)]

    def of_window(self, first: int) -> list[int]:
        """Gives the instant, counted from 1, of each slot of the window that begins with coarse interval `first`.

        Slots beyond the gap's end repeat its last instant.
        """
        each = 1 << self.depth
        made = [k * each + j for k in range(first, first + self.per_window) for j in range(1, each)]
        return [min(i, self.count) for i in made]

    def stamps(self, t_a: int, t_b: int) -> np.ndarray:
        """Gives the times int64 [count] ns of all instants between two keyframes."""
        return subframe_stamps(t_a, t_b, self.count)


def instants_of(gap_ns: int, coarse: int, tolerance_ns: float, pixels: int, looks: int, cpu: bool) -> Instants:
    """Chooses instants so close that the middle between two of them is within the tolerance of any crossing there.

    Args:
        gap_ns: length of the gap.
        coarse: K.
        tolerance_ns: greatest error wanted in the time of a crossing.
        pixels: of all environments at one instant.
        looks: least number of parts of a coarse interval, a power of two.
        cpu: whether kernels run on a CPU.
    """
    wanted, least = _halvings(gap_ns, coarse, tolerance_ns, looks), looks.bit_length() - 1
    room = max(1, (ROWS if cpu else MOST) // max(pixels, 1))
    fits = [int(math.log2(most // max(pixels, 1) + 1)) for most in (MOST, INDEXED)]
    depth = min(wanted, DEEPEST, max(fits[0], min(least, fits[1])))
    per_window = max(1, min(coarse, room // max((1 << depth) - 1, 1)))
    # As many in each window as in any other.
    return Instants(coarse, depth, -(-coarse // -(-coarse // per_window)), depth == wanted)


def least_parts(coarse: int) -> int:
    """Gives the least number of parts of each of so many coarse intervals, a power of two."""
    return 1 << (max(LEAST_LOOKS, -(-LOOKS // coarse)) - 1).bit_length()


def wanted_slots(gap_ns: int, coarse: int, tolerance_ns: float) -> int:
    """Counts the instants inside the coarse intervals of a gap that a tolerance of time asks for."""
    return coarse * ((1 << min(_halvings(gap_ns, coarse, tolerance_ns, least_parts(coarse)), DEEPEST)) - 1)


def _halvings(gap_ns: int, coarse: int, tolerance_ns: float, looks: int) -> int:
    """Computes how often a coarse interval is to be halved, 0 where it is within the tolerance by itself."""
    # The same for all gaps of one rate, whose ends are rounded.
    wanted = max(0, math.ceil(math.log2(max(gap_ns / coarse / (2 * tolerance_ns), 1e-9)) - ROUNDED))
    return max(wanted, looks.bit_length() - 1) if wanted else 0
