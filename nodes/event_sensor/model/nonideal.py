"""The engine of curves and faults."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp

from nodes.event_sensor.engines import Batch, Size, features_of, pattern_of
from nodes.event_sensor.model.inactive_kernels import Quiet, arrays_of, quiet_state, runs_of
from nodes.event_sensor.model.pixel_kernels import Sensor
from nodes.event_sensor.model.state_kernels import Cold
from nodes.event_sensor.model.thread_kernels import full_kernels


class Full:
    """An engine, see `engines`: any curve through the samples, and faults."""

    sorts = False

    def __init__(self, size: Size, seed: int, p: Mapping[str, Any], device: Any) -> None:
        total = size.envs * size.pixels
        features = features_of(p)
        self._kernel = full_kernels(features)[device.is_cuda]
        self._size, self._device, self.in_place = size, device, not device.is_cuda

        def state() -> tuple[Quiet, wp.array]:
            side: wp.array = wp.zeros(0 if self.in_place else total, dtype=wp.int32, device=device)
            return quiet_state(total, features.timed, features.curved, device), side

        self._before = state()
        self._after = self._before if self.in_place else state()
        self._loud: wp.array = wp.zeros(size.width * size.channels + 1, dtype=wp.int32, device=device)
        struct: Any = Cold
        colds: Any = np.zeros((1 if self.in_place else 2, total), struct.numpy_dtype())
        for name, values in zip(("c_on", "c_off", "leak", "hot"), pattern_of(size, seed, p)):
            if values.size:
                colds[name] = values.reshape(-1)
        self._colds: wp.array = wp.array(colds, dtype=Cold, device=device)

    def arrays(self) -> tuple[wp.array, ...]:
        """Everything that is kept per pixel."""
        states = (self._before,) if self.in_place else (self._before, self._after)
        kept = (a for quiet, side in states for a in (*arrays_of(quiet), side))
        return *kept, self._colds

    def launch(self, sensor: Sensor, batch: Batch, keys: wp.array, counters: wp.array, resume: int) -> None:
        """Events of a batch to `keys`, as many as fit. In place: from pixel resume - 1 to the first without room."""
        b = batch
        steps = [b.frames, b.count, b.t, b.t_base, b.t_before]
        if self.in_place:
            frames = [b.images, runs_of(b.images), b.slopes, runs_of(b.slopes)]
            inputs = [sensor, b.begin, b.episodes, *frames, *steps, resume]
            outputs = [*self._before, self._loud, self._colds, keys, counters]
        else:
            inputs = [sensor, b.begin, b.episodes, b.images, b.slopes, *steps, *self._before]
            outputs = [*self._after, self._colds, keys, counters]
        wp.launch(self._kernel, self._size.threads(not self.in_place), inputs, outputs, device=self._device)

    def swap(self) -> None:
        self._before, self._after = self._after, self._before
