"""Defines what an engine of the sensor does."""

from __future__ import annotations

from typing import Protocol

import warp as wp

from nodes.event_sensor.input.batch import Batch
from nodes.event_sensor.model.sensor_kernels import Sensor


class Engine(Protocol):
    """Keeps the state of the pixels, and launches the kernels that turn frames into events.

    sorts: its keys come in the order of time.

    An engine either changes the state where it is, and goes on at the pixel at which the room for events ran out; or it
    reads the state before a message and writes the state after it, so that its launch can be repeated with more room.
    On a GPU the ideal sensor has no engine of this kind but cuda.ideal.IdealPasses, a cuda.source.Source.
    """

    sorts: bool

    def kernels(self) -> list[tuple[wp.Kernel, int]]:
        """Gives the kernels that are launched, as `build_together` takes them."""

    def arrays(self) -> tuple[wp.array, ...]:
        """Returns all arrays of the pixels' state."""

    def present(self) -> dict[str, wp.array]:
        """Names the arrays that the next call goes on from."""

    def launch(self, sensor: Sensor, batch: Batch, keys: wp.array, counters: wp.array, resume: int) -> None:
        """Writes the events of a batch to `keys`, as many as fit.

        Args:
            sensor: its parameters, with the room that there is for events.
            batch: on the device.
            keys: int64 [capacity], see model.keys.
            counters: int64, those of COUNTERS and, behind them, where a launch in place has stopped; 0 = nowhere.
            resume: where the last launch for this batch has stopped; 0 for the first one.
        """

    def swap(self) -> None:
        """Makes the state after the batch the present one, where it is apart."""
