"""Lists the events of a call on a CPU in the order of time; the list is as long as it has to be."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from evis.gpu.building import LAUNCH_BLOCK
from nodes.event_sensor.cpu import order_kernels
from nodes.event_sensor.cpu.order import env_offsets, sort_keys, unpack
from nodes.event_sensor.cpu.simd_kernels import SPARE
from nodes.event_sensor.engines.interface import Engine
from nodes.event_sensor.input.limit import check_events, check_host_memory
from nodes.event_sensor.model.keys import KeyLayout
from nodes.event_sensor.model.sensor_kernels import COUNTERS, Sensor


class HostEventList:
    """Lists the events of the last call on the host, as DeviceEventList does on a GPU.

    total: pixels of all environments. found: called with the counters of each call. ordered: in the order of time; else
    by environment alone, for whoever sorts them later.
    """

    def __init__(
        self, engine: Engine, sensor: Sensor, layout: KeyLayout, envs: int, total: int,
        found: Callable[[np.ndarray], None], ordered: bool = True,
    ) -> None:  # fmt: skip
        self._sorts = ordered and not engine.sorts
        self._engine, self._sensor, self._layout, self._envs, self._found = engine, sensor, layout, envs, found
        self._counters: wp.array = wp.zeros(len(COUNTERS) + 1, dtype=wp.int64, device="cpu")
        self._listed = np.zeros(0, np.int64)
        self._t_base = 0
        self._grow(max(2 * total, 4096))

    def kernels(self) -> list[tuple[wp.Kernel, int]]:
        """Gives a kernel of the module that sorts and unpacks, as `build_together` takes it."""
        return [(order_kernels.unpack, LAUNCH_BLOCK)]

    def _grow(self, capacity: int) -> None:
        self._keys: wp.array = wp.empty(capacity + SPARE, dtype=wp.int64, device="cpu")
        self._spare: wp.array = wp.empty(capacity if self._sorts else 0, dtype=wp.int64, device="cpu")
        self._capacity = capacity
        self._sensor.capacity = wp.int64(capacity)

    def fill(self, batch: Any, stamp: int) -> None:
        """Runs the kernel on a batch that ends at `stamp`, and sorts its events.

        Where the events did not fit, the kernel goes on, or is run again, with a longer list.
        """
        self._t_base = batch.t_base
        count = 0
        if batch.count:
            found = self._run(batch.on("cpu"))
            self._found(found)
            count = int(found[0])
        if self._sorts:
            self._listed = sort_keys(self._keys, self._spare, count, self._layout, stamp - batch.t_base)
        else:
            self._listed = self._keys.numpy()[:count]

    def clear(self) -> None:
        """Forgets the events."""
        self._listed = np.zeros(0, np.int64)

    def _run(self, batch: Any) -> np.ndarray:
        self._counters.zero_()
        resume = 0
        while True:
            self._engine.launch(self._sensor, batch, self._keys, self._counters, resume)
            found = np.array(self._counters.numpy())
            count, left = int(found[0]), int(found[-1])
            if not left and count <= self._capacity:
                self._engine.swap()
                return found[:-1]
            capacity = 2 * self._capacity if left else count + count // 4
            check_events(max(count, left and capacity))
            check_host_memory(capacity)
            keys = self._keys
            self._grow(capacity)
            if left:
                self._keys.numpy()[:count] = keys.numpy()[:count]
                self._counters.numpy()[-1] = 0
                resume = left
            else:
                self._counters.zero_()

    def __len__(self) -> int:
        return len(self._listed)

    def read(self, out: dict[str, np.ndarray]) -> None:
        """Writes the events to columns of their length."""
        if not self._layout.marked:
            unpack(self._listed, self._sensor, self._t_base, out)
            return
        if "signal" in out:
            out["signal"][:] = 1 - (self._listed & 1)
        plain: Any = Sensor()
        layout = self._layout.without_mark()
        plain.shift_x, plain.shift_y, plain.shift_t, plain.shift_env = layout.x, layout.y, layout.t, layout.env
        unpack(self._listed >> 1, plain, self._t_base, out)

    def env_offsets(self) -> np.ndarray:
        """Returns int64 [E + 1]: where each environment's events begin."""
        return env_offsets(self._listed, self._layout, self._envs)
