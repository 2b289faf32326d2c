"""Makes a source of events for the pipeline on a GPU from an engine: with curves, faults or the paper's equations."""

from __future__ import annotations

from typing import Any

import warp as wp

from nodes.event_sensor.engines.interface import Engine
from nodes.event_sensor.model.sensor_kernels import Sensor


class RelaunchedEngine:
    """Runs an engine that keeps the state before a call apart, so that the call can be made again with more room."""

    repeats = True
    records = False

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self.batch: Any = None

    def find(
        self, sensor: Sensor, call: wp.array, frames: int, filled: wp.array, counters: wp.array, before: wp.array
    ) -> None:
        """Empties the buckets. Args: see source.Source."""
        filled.zero_()

    def sense(self, sensor: Sensor, call: wp.array, frames: int, keys: wp.array, counters: wp.array) -> None:
        """Lists all events of `batch`. Args: see source.Source."""
        self._engine.launch(sensor, self.batch, keys, counters, 0)

    def done(self) -> None:
        """Makes the state after the call the present one."""
        self._engine.swap()
        self.batch = None
