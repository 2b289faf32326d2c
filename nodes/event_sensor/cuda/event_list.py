"""Lists the events of a sensor on a CUDA device, as cpu.event_list does on a CPU, and keeps calls in flight."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import warp as wp

from nodes.event_sensor.cuda.call_kernels import (
    FIRST,
    FOUND,
    IMAGES,
    OFFSET,
    SHARED,
    SPAN,
    STAMPS,
    T_BASE,
    VALUE,
)
from nodes.event_sensor.cuda.ideal import IdealPasses
from nodes.event_sensor.cuda.pipeline import Pipeline
from nodes.event_sensor.cuda.relaunched import RelaunchedEngine
from nodes.event_sensor.model.keys import KeyLayout
from nodes.event_sensor.model.sensor_kernels import Sensor
from nodes.event_sensor.readout.device_events import CALLS, DeviceEvents, Pending


class DeviceEventList:
    """Lists the events of a sensor on a device: those of the last call, or of calls in flight."""

    def __init__(
        self, engine: Any, sensor: Sensor, layout: KeyLayout, shape: tuple[int, int, bool], stamped: bool, device: Any,
        found: Callable[[np.ndarray], None],
    ) -> None:  # fmt: skip
        """Makes the pipeline.

        Args:
            engine: one of engines.engine.make_engine.
            sensor: its parameters.
            layout: of the keys.
            shape: environments, pixels of all of them, colour.
            stamped: most events have their frame's stamp.
            device: Warp's.
            found: called with the counters of each call.
        """
        envs, total, colour = shape
        self._marked = layout.marked
        self._relaunched = None if isinstance(engine, IdealPasses) else RelaunchedEngine(engine)
        self._device, self._found = device, found
        self.pipeline = Pipeline(
            self._relaunched or engine, sensor, layout, total, envs, colour, stamped, CALLS, device, found
        )
        self._none = self._nothing(envs, colour)
        self.events = self._none

    def _nothing(self, envs: int, colour: bool) -> DeviceEvents:
        types = {"t": wp.int64, "x": wp.uint16, "y": wp.uint16, "p": wp.uint8} | ({"c": wp.uint8} if colour else {})
        types |= {"signal": wp.uint8} if self._marked else {}
        columns = {name: wp.empty(0, dtype=dtype, device=self._device) for name, dtype in types.items()}
        return DeviceEvents(columns, 0, np.zeros(envs + 1, np.int64), (0, 0))

    def kernels(self) -> list[tuple[wp.Kernel, int]]:
        """Gives the kernels that put events in order, as `build_together` takes them."""
        return self.pipeline.kernels()

    @property
    def pipelined(self) -> bool:
        """Tells whether several calls may be in flight."""
        return self._relaunched is None

    def submit(self, batch: Any, stamp: int, defer: bool = False) -> Pending:
        """Launches a batch that ends at `stamp`; its frames must stay as they are until the result is there."""
        count = batch.count
        call = self.pipeline.parameters(count)
        call[IMAGES], call[T_BASE], call[SPAN] = batch.images.ptr, batch.t_base, stamp - batch.t_base
        lists = batch.further
        if lists is None:
            call[FIRST] = 0
        else:
            # Arrays of no elements have no address.
            call[FIRST], call[OFFSET], call[VALUE] = (a.ptr or 0 for a in (lists.first, lists.offset, lists.value))
            call[SHARED], call[FOUND] = lists.shared, 0 if lists.found is None else lists.found.ptr
        call[STAMPS : STAMPS + count] = batch.t[:count]
        call[STAMPS + count :] = batch.begin
        if self._relaunched is not None:
            self._relaunched.batch = batch.on(self._device)
        return self.pipeline.submit(count, (batch.t_base, stamp), (batch.images, lists), defer)

    def fill(self, batch: Any, stamp: int) -> None:
        """Launches a batch as `submit` does, and waits for the events."""
        self.events = self.submit(batch, stamp).result() if batch.count else self._none

    def clear(self) -> None:
        """Forgets the events."""
        self.events = self._none

    def __len__(self) -> int:
        return self.events.count

    def read(self, out: Mapping[str, np.ndarray | wp.array]) -> None:
        """Writes the events to columns of their length, of numpy or on the device."""
        self.events.read(out)

    def env_offsets(self) -> np.ndarray:
        """Returns int64 [E + 1]: where each environment's events begin."""
        return self.events.env_offsets
