"""Measures what a candidate costs on a GPU, for the probe.

There the host prepares one stage while the device is still at the one before, and hides what it takes to launch work;
the sum of stages that each wait for the device is off by all of that, the more the cheaper they are. So some gaps of
the run itself are timed: keyframe, frames and events in a row, with one wait at the end.
"""

from __future__ import annotations

import numpy as np

from evis.runtime.clock import keyframe_count
from nodes.interpolator.auto.chain import Chain
from nodes.interpolator.auto.cost import FullSize, GapCost
from nodes.interpolator.auto.setting import Setting, Way
from nodes.interpolator.auto.world import World

GAPS = 12
"""Gaps of a round that count, where a run has so many."""
COUNTED = 24
"""Gaps that count in all rounds, about; the shortest round is believed. The first one finds memory for events."""
DENSE_HZ = (250.0, 1000.0)
"""Rates at which dense rendering is timed [Hz]: a frame has the more events, the longer the time before it."""


class Overlapped(FullSize):
    """Measures whole gaps at full size, from the keyframe to the events; their whole cost is in `gaps`."""

    def __init__(self, setting: Setting, world: World, starts: list[int]) -> None:
        super().__init__(setting, world, starts)
        self._chain = Chain(setting, world)
        self.dense = GapCost(0.0, 0.0)
        """Seconds of dense rendering per simulated second, for what changes in it, and per frame, of an environment."""

    def measure_gap(self, method: str, rate: float) -> None:
        """Measures gaps of a method at a keyframe rate [Hz], of two K where it can, to tell what grows with K."""
        counts = self._counts()
        spent = [self._timed((method, rate, k)) for k in counts]
        frame = spent[0] / counts[0]
        if len(counts) > 1:
            frame = float(np.clip((spent[1] - spent[0]) / (counts[1] - counts[0]), 0.0, frame))
        self.gaps[method, rate] = GapCost(spent[0] - counts[0] * frame, frame)

    def seconds(self, way: Way) -> float | None:
        """Predicts the run time of a way, as FullSize does."""
        method, rate, k = way
        return self.dense.fixed + rate * k * self.dense.frame if method == "none" else self._of_gaps(way)

    def _measure_others(self, pairs: list[tuple[np.ndarray, np.ndarray]]) -> None:
        """Measures dense rendering as a whole. pairs: not needed."""
        few, many = (self._timed(("none", rate, 1)) for rate in DENSE_HZ)
        change = max(few - many, 0.0) / (1 / DENSE_HZ[0] - 1 / DENSE_HZ[1])
        self.dense = GapCost(change, max(many - change / DENSE_HZ[1], 0.0))

    def _timed(self, way: Way) -> float:
        """Measures the time [s] of a gap of one environment; of dense rendering, of a frame."""
        gaps = int(np.clip(keyframe_count(self._world.end_ns, way[1]) - 2, 0, GAPS))
        rounds = 1 + COUNTED // (2 * max(gaps, 4))
        return min(self._chain.gap(way, gaps) for _ in range(rounds))
