"""Senses the ideal sensor's pixels that have further samples, on a CPU, and merges their events with those of the
others."""

from __future__ import annotations

import numpy as np
import warp as wp

from nodes.event_sensor.cpu import further_kernels as kernels
from nodes.event_sensor.cpu.order import sort_keys
from nodes.event_sensor.cpu.simd_kernels import IdealState
from nodes.event_sensor.input.batch import Batch, SampleLists
from nodes.event_sensor.model.keys import KeyLayout
from nodes.event_sensor.model.sensor_kernels import EVENTS, Sensor

FIRST_ROOM = 4096


class FurtherPixels:
    """Senses pixels with further samples; `keys` are those of their events in the last message, in order."""

    def __init__(self, layout: KeyLayout) -> None:
        """Makes empty lists. layout: of the keys."""
        self._layout = layout
        self._grow(FIRST_ROOM)
        self.keys: np.ndarray = self._list.numpy()[:0]

    def _grow(self, room: int) -> None:
        self._list: wp.array = wp.empty(room, dtype=wp.int64, device="cpu")
        self._spare: wp.array = wp.empty(room, dtype=wp.int64, device="cpu")

    def sense(self, sensor: Sensor, batch: Batch, lists: SampleLists, state: IdealState, counters: np.ndarray) -> None:
        """Takes the pixels through a message; what they count is added to `counters`, but for their events."""
        capacity = sensor.capacity
        own = np.zeros_like(counters)
        progress: wp.array = wp.zeros(2, dtype=wp.int64, device="cpu")
        place = progress.numpy()
        envs = len(batch.begin)
        found: wp.array = wp.array(own, dtype=wp.int64, device="cpu", copy=False)
        while place[kernels.AT_ENV] < envs:
            sensor.capacity = wp.int64(len(self._list))
            inputs = [sensor, batch.images, batch.t, batch.t_base, envs]
            inputs += [lists.first, lists.offset, lists.value, lists.shared]
            wp.launch(kernels.sense_further, 1, [*inputs, state, progress], [self._list, found], device="cpu")
            if place[kernels.AT_ENV] < envs:
                kept = self._list.numpy()[: own[EVENTS]]
                self._grow(max(2 * len(self._list), len(kept) + FIRST_ROOM))
                self._list.numpy()[: len(kept)] = kept
        sensor.capacity = capacity
        count, own[EVENTS] = int(own[EVENTS]), 0
        counters += own
        span = int(batch.t.numpy()[-1]) - batch.t_base
        self.keys = sort_keys(self._list, self._spare, count, self._layout, span)

    def join(self, keys: wp.array, count: int) -> None:
        """Merges `keys` of the last message into the `count` sorted ones of a list with room for them."""
        if len(self.keys):
            more: wp.array = wp.array(self.keys, dtype=wp.int64, device="cpu", copy=False)
            wp.launch(kernels.merge, 1, [more, len(self.keys), count], [keys], device="cpu")
