"""Implements the engine of curves and faults."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from evis.gpu.building import LAUNCH_BLOCK
from nodes.event_sensor.cpu.nonideal_kernels import make_sense_rows
from nodes.event_sensor.cuda.nonideal_kernels import make_sense_pixels
from nodes.event_sensor.input.batch import Batch, Size
from nodes.event_sensor.input.between_kernels import between
from nodes.event_sensor.model.faults.fixed_pattern import pattern_of
from nodes.event_sensor.model.features import features_of
from nodes.event_sensor.model.sensor_kernels import Sensor
from nodes.event_sensor.model.state_kernels import FrequentState, Rare, arrays_of, frequent_state, runs_of


class NonIdealEngine:
    """Implements an Engine for any curve through the samples, and for faults."""

    sorts = False

    def __init__(self, size: Size, seed: int, p: Mapping[str, Any], device: Any) -> None:
        total = size.envs * size.pixels
        features = self._features = features_of(p)
        self._make = make_sense_pixels if device.is_cuda else make_sense_rows
        self._make(features)
        self._size, self._device, self.in_place = size, device, not device.is_cuda

        def state() -> tuple[FrequentState, wp.array]:
            side: wp.array = wp.zeros(0 if self.in_place else total, dtype=wp.int32, device=device)
            return frequent_state(total, features.timed, features.curved, device), side

        self._before = state()
        self._after = self._before if self.in_place else state()
        self._active: wp.array = wp.zeros(size.width * size.channels + 1, dtype=wp.int32, device=device)
        struct: Any = Rare
        rare: Any = np.zeros((1 if self.in_place else 2, total), struct.numpy_dtype())
        for name, values in pattern_of(size, seed, p).items():
            rare[name] = values
        self._rare: wp.array = wp.array(rare, dtype=Rare, device=device)

    def kernels(self) -> list[tuple[wp.Kernel, int]]:
        """Gives the kernel that is launched, as `build_together` takes it; for further samples there is another."""
        return [(self._make(self._features), LAUNCH_BLOCK)]

    def arrays(self) -> tuple[wp.array, ...]:
        """Returns all arrays of the pixels' state."""
        states = (self._before,) if self.in_place else (self._before, self._after)
        kept = (a for state, side in states for a in (*arrays_of(state), side))
        return *kept, self._rare

    def present(self) -> dict[str, wp.array]:
        """Names the arrays that the next call goes on from."""
        state, side = self._before
        kept = zip(("last", "low", "high", "early", "earlier", "wake"), arrays_of(state))
        return {**dict(kept), "side": side, "rare": self._rare}

    def launch(self, sensor: Sensor, batch: Batch, keys: wp.array, counters: wp.array, resume: int) -> None:
        """Writes the events of a batch to `keys`, as many as fit.

        In place: from pixel resume - 1 to the first without room.
        """
        b = batch
        message = [b.images, b.slopes, b.frames, b.count, b.t, b.t_base, b.t_before, b.episodes]
        message.append(between(b.further))
        if self.in_place:
            runs = [runs_of(b.images), runs_of(b.slopes)]
            inputs = [sensor, b.begin, *message, *runs, resume]
            outputs = [*self._before, self._active, self._rare, keys, counters]
        else:
            inputs = [sensor, b.begin, *message, *self._before]
            outputs = [*self._after, self._rare, keys, counters]
        kernel = self._make(replace(self._features, further=b.further is not None))
        wp.launch(kernel, self._size.threads(not self.in_place), inputs, outputs, device=self._device)

    def swap(self) -> None:
        self._before, self._after = self._after, self._before
