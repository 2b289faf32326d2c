"""Collects the run's events of the audited pixels, and measures how far they are from those of brute force."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from nodes.audit.comparison import Comparison, Train
from nodes.event_sensor.input.further import Further
from nodes.event_sensor.sensor import EventSensor

NONE = (np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0, np.uint8))


@dataclass(frozen=True)
class Gap:
    """Holds what a run has of a gap: values float32 [A, K, n] at stamps t int64 [K] ns, and samples of single pixels
    between them, if there are any."""

    values: np.ndarray
    t: np.ndarray
    between: Further | None


class RunEvents:
    """Senses a run's values of `each` pixels of `envs` environments without noise, and adds up their error."""

    def __init__(self, envs: int, each: int, ideal: Mapping[str, Any], samples: bool) -> None:
        """ideal: parameters of the event sensor. samples: those between frames count, not the frames alone."""
        self.sensor = EventSensor(1, each, envs, **ideal)
        self.comparison = Comparison(envs * each)
        self._each, self._samples = each, samples

    def events(self, gaps: Sequence[Gap], episodes: np.ndarray) -> Train:
        """Gives the events of the next gaps, by pixel and time. episodes: int32 [A]."""
        between = [gap.between if self._samples else None for gap in gaps]
        parts = [(gap.values, gap.t, own) for gap, own in zip(gaps, between)]
        if all(own is None for own in between):
            parts = [(np.concatenate([gap.values for gap in gaps], 1), np.concatenate([gap.t for gap in gaps]), None)]
        made = [self.sensor.process(values[:, :, None], t, episodes, further=own) for values, t, own in parts]
        pixel, time, sign = (np.concatenate(column) for column in zip(*map(self._train, made)))
        order = np.lexsort((time, pixel))
        return pixel[order], time[order], sign[order]

    def rest(self) -> Train:
        """Gives the events that look-ahead has held back, at the end of an episode of all environments."""
        return self._train(self.sensor.flush()) if self.sensor.stamp else NONE

    def _train(self, events: Any) -> Train:
        env = np.repeat(np.arange(len(events.env_offsets) - 1), np.diff(events.env_offsets))
        return env * self._each + events.x.astype(np.int64), events.t, events.p
