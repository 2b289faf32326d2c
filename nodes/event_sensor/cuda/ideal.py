"""Implements the ideal sensor on a GPU: its state and its two launches."""

from __future__ import annotations

from typing import Any

import warp as wp

from evis.gpu.building import LAUNCH_BLOCK
from nodes.event_sensor.cuda import active_kernels, ideal_kernels
from nodes.event_sensor.model.sensor_kernels import Sensor

BLOCK = 32
"""A warp: threads take unlike times, and a block keeps its place on the GPU until its last one ends. Of 128 threads the
pass takes 4 to 15 % longer on an H200, of 256 up to 40 %."""
SHARE = active_kernels.BLOCK * active_kernels.EACH
THREADS = 1 << 20
"""Most of the second launch, each of which takes every THREADS-th active pixel: several times what a GPU holds at once,
so that none is left to the last ones."""


class IdealPasses:
    """Keeps the state of `total` pixels and channels, `size` in each environment, and lists the active ones.

    28 bytes of state per pixel and channel, and 8 of list.
    """

    repeats = False
    records = True

    def __init__(self, total: int, size: int, frame: bool, device: Any) -> None:
        self._size, self._device = size, device
        # Of one environment a call may have the frames of many messages. With few frames threads lose more by going
        # apart than they gain: 30 % of the pass for eight warehouses of 4 frames and 1,024 disks of 8.
        self._kernel = ideal_kernels.make_sense_active(frame, ahead=total == size)
        self._state = ideal_kernels.IdealState()
        self._state.last = wp.zeros(total, dtype=wp.float32, device=device)
        self._state.low = wp.full(total, float("inf"), dtype=wp.float32, device=device)
        self._state.high = wp.zeros(total, dtype=wp.float32, device=device)
        self._state.counts = wp.zeros(total, dtype=wp.vec2i, device=device)
        self._state.base = wp.zeros(total, dtype=wp.float64, device=device)
        self._active: wp.array = wp.empty(total, dtype=wp.vec2i, device=device)

    def arrays(self) -> tuple[wp.array, ...]:
        """Returns all arrays of the pixels' state, and the list of active ones."""
        s = self._state
        return s.last, s.low, s.high, s.counts, s.base, self._active

    def present(self) -> dict[str, wp.array]:
        """Names the arrays that the next call goes on from, once all calls in flight are done."""
        return {name: getattr(self._state, name) for name in ("last", "low", "high", "counts", "base")}

    def kernels(self) -> list[tuple[wp.Kernel, int]]:
        """Gives the kernels that are launched, as `build_together` takes them."""
        return [(self._kernel, BLOCK), (active_kernels.find_active, LAUNCH_BLOCK)]

    def find(
        self, sensor: Sensor, call: wp.array, frames: int, filled: wp.array, counters: wp.array, before: wp.array
    ) -> None:
        """Empties the buckets and lists the active pixels. Args: see source.Source."""
        threads = -(-self._active.size // SHARE) * active_kernels.BLOCK
        wp.launch(
            active_kernels.find_active,
            max(threads, filled.size),
            [sensor, call, frames, self._size, before, self._state],
            [self._active, filled, counters],
            device=self._device,
        )

    def sense(self, sensor: Sensor, call: wp.array, frames: int, keys: wp.array, counters: wp.array) -> None:
        """Lists the events of the active pixels, from where they were left, as many as fit.

        Args: see source.Source.
        """
        threads = min(self._active.size, THREADS)
        wp.launch(
            self._kernel,
            threads,
            [sensor, call, frames, self._size, threads, self._state, self._active],
            [keys, counters],
            device=self._device,
            block_dim=BLOCK,
        )

    def done(self) -> None:
        """Does nothing: the state is changed in place."""
