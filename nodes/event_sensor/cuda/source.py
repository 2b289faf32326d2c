"""Defines what lists the events of a pipeline's calls: the ideal sensor's passes, or an engine that is relaunched."""

from __future__ import annotations

from typing import Protocol

import warp as wp

from nodes.event_sensor.model.sensor_kernels import Sensor


class Source(Protocol):
    """Lists the events of a call.

    repeats: it lists all of them again where they did not fit, and not only those that did not. records: its launches
    may be recorded.
    """

    repeats: bool
    records: bool

    def find(
        self, sensor: Sensor, call: wp.array, frames: int, filled: wp.array, counters: wp.array, before: wp.array
    ) -> None:
        """Prepares a call, once in each, and empties the buckets.

        Args:
            sensor: its parameters, with the room that there is for events.
            call: parameters of the call, int64 [8 + K + E], see call_kernels.
            frames: K.
            filled: events in each bucket, int32.
            counters: of this call, int64 [COUNTS].
            before: the counters of the call before.
        """

    def sense(self, sensor: Sensor, call: wp.array, frames: int, keys: wp.array, counters: wp.array) -> None:
        """Lists the events; and again, with more room, where they did not fit.

        Args:
            sensor, call, frames: as in `find`.
            keys: the list, int64 [capacity], see model.keys.
            counters: of this call, int64 [COUNTS].
        """

    def done(self) -> None:
        """Takes note that all events of the call are listed."""
