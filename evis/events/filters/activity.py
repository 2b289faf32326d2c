"""Tells lone events from those that have another beside them, as the edges of a scene make them."""

from __future__ import annotations

import numpy as np
import warp as wp

from evis.events.arrays import Events
from evis.events.filters import activity_kernels as kernels
from evis.events.pixel_limit import check_pixels
from evis.warp_start import start_warp


class ActivityFilter:
    """Keeps an event where one of its pixel's eight neighbours had one within a time before it, over as many packets as
    come.

    T. Delbruck, Frame-free dynamic digital vision, 2008 (background activity filter). The first event of an edge that
    comes to a quiet place is left out with the noise, and of two noisy pixels side by side some events stay.

    Args:
        width, height: of the sensor [px].
        within_ns: the time [ns].
    """

    def __init__(self, width: int, height: int, within_ns: int) -> None:
        """Begins with a quiet sensor. Raises ValueError, and AllowanceError for a sensor that is too large."""
        if within_ns < 1:
            raise ValueError(f"within_ns is {within_ns}; a neighbour's event must be allowed 1 ns at least")
        check_pixels(width, height)
        start_warp()
        self._within_ns = within_ns
        self._latest = wp.full((height, width), kernels.NEVER, dtype=wp.int64, device="cpu")

    def keep(self, events: Events) -> np.ndarray:
        """Tells which of the next events are kept, bool [n]; those outside of the sensor are.

        Events count in the order in which they come; of one that came late the neighbours may have later times.
        """
        kept = np.empty(len(events), bool)
        if len(events):
            columns = [_view(column) for column in (events.t, events.x, events.y)]
            outputs = [self._latest, _view(kept.view(np.uint8))]
            wp.launch(kernels.beside_another, 1, [*columns, self._within_ns], outputs, device="cpu")
        return kept

    def __call__(self, events: Events) -> Events:
        """Returns those of the next events that are kept, with the triggers, inertial samples and frames."""
        return events[self.keep(events)].beside(events)


def _view(column: np.ndarray) -> wp.array:
    return wp.array(np.ascontiguousarray(column), copy=False, device="cpu")
