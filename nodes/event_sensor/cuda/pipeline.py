"""Runs calls of the sensor on a device: parameters in, graph launched, events and counts out, several calls in
flight."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import warp as wp

from nodes.event_sensor.cuda import call_kernels
from nodes.event_sensor.cuda.order import Order
from nodes.event_sensor.cuda.slot import CallParameters, Slot, fresh_counters
from nodes.event_sensor.cuda.source import Source
from nodes.event_sensor.input.limit import check_events
from nodes.event_sensor.model.key_kernels import Columns
from nodes.event_sensor.model.keys import KeyLayout
from nodes.event_sensor.model.sensor_kernels import COUNTERS, Sensor
from nodes.event_sensor.readout.device_events import DeviceEvents, Pending

FIRST_CAPACITY = 1 << 20
"""Most events for which there is room before a call has needed more."""
LEAST_ROOM = 4096
"""Events for which there is room at first, and more room each time, at least."""
GRAPHS = 16
"""Different numbers of frames a call for which graphs are kept."""


class Pipeline:
    """Sends calls to a device, several in flight, and gives their events in order.

    records: a call of a number of frames that was there before launches a graph.
    """

    def __init__(
        self, source: Source, sensor: Sensor, layout: KeyLayout, total: int, envs: int, colour: bool, stamped: bool,
        calls: int, device: Any, found: Callable[[np.ndarray], None],
    ) -> None:  # fmt: skip
        """Makes the buffers.

        Args:
            source: what lists the events of a call.
            sensor: its parameters; `capacity` is set here.
            layout: of the keys.
            total: pixels and channels of all environments.
            envs: number of environments.
            colour: events have a channel.
            stamped: most events have the stamp of their frame.
            calls: most calls in flight.
            device: Warp's.
            found: called with the counters of every completed call, in order.
        """
        self._source, self._sensor, self._layout, self._found = source, sensor, layout, found
        self._envs, self._colour, self._device, self._calls = envs, colour, device, calls
        self._order = Order(envs, stamped, device)
        self.records = device.is_cuda and source.records
        self._serial = self._collected = 0
        self._slots = [self._slot(number) for number in range(calls)]
        self._unordered: Slot | None = None
        self._aside: Any = None
        if self.records:
            self._aside, self._fork, self._join = wp.Stream(device), wp.Event(device), wp.Event(device)
        self.grow(min(max(2 * total, LEAST_ROOM), FIRST_CAPACITY))

    def _slot(self, number: int) -> Slot:
        host = self._pinned(call_kernels.OFFSETS + self._envs + 1)
        head = self._seen_by_device(host)
        counters: wp.array = wp.array(fresh_counters(), dtype=wp.int64, device=self._device)
        event = wp.Event(self._device) if self._device.is_cuda else None
        return Slot(number, counters, head, host, host.numpy(), event)

    def _pinned(self, length: int) -> wp.array:
        """Makes an array of the host, int64, that the device can reach."""
        return wp.zeros(length, dtype=wp.int64, device="cpu", pinned=self._device.is_cuda)

    def _seen_by_device(self, host: wp.array) -> wp.array:
        """Gives the memory of a pinned array as one of the device, which writes there by itself."""
        return wp.array(ptr=host.ptr, shape=host.shape, dtype=host.dtype, device=self._device)

    def kernels(self) -> list[tuple[wp.Kernel, int]]:
        """Gives the kernels that put events in order, as `build_together` takes them."""
        return self._order.kernels()

    def grow(self, capacity: int) -> None:
        """Makes room for so many events in a call. Events given out keep the arrays that they have."""
        check_events(capacity)
        self._sensor.capacity = wp.int64(capacity)
        self._order.reserve(capacity)
        for slot in self._slots:
            slot.keys = wp.empty(capacity, dtype=wp.int64, device=self._device)
            slot.columns, slot.named = self._columns(capacity)
        self._forget()

    def _columns(self, capacity: int) -> tuple[Any, dict[str, wp.array]]:
        columns = Columns()
        types = {"t": wp.int64, "x": wp.uint16, "y": wp.uint16, "p": wp.uint8, "c": wp.uint8}
        types["signal"] = wp.uint8
        there = {"c": self._colour, "signal": self._layout.marked}
        named = {}
        for name, dtype in types.items():
            length = capacity if there.get(name, True) else 0
            array: wp.array = wp.empty(length, dtype=dtype, device=self._device)
            setattr(columns, name, array)
            if length:
                named[name] = array
        return columns, named

    def _forget(self) -> None:
        """Forgets the graphs, whose arrays are not the present ones any more."""
        for slot in self._slots:
            for call in slot.by_frames.values():
                call.graphs.clear()

    def parameters(self, frames: int) -> np.ndarray:
        """Returns the int64 [8 + K + E] of the next call, to be filled: see nodes.event_sensor.cuda.call_kernels.

        Raises ValueError where too many calls are in flight.
        """
        slot = self._slots[self._serial % self._calls]
        if slot.pending is not None and slot.pending.events is None:
            raise ValueError(f"{self._calls} calls are in flight; take the result() of the first before the next")
        call = slot.by_frames.get(frames)
        if call is None:
            if len(slot.by_frames) >= GRAPHS:
                slot.by_frames.clear()
            length = call_kernels.STAMPS + frames + self._envs
            staging, ends_host = self._pinned(length), self._pinned(frames)
            device: wp.array = wp.zeros(length, dtype=wp.int64, device=self._device)
            ends = self._seen_by_device(ends_host)
            call = CallParameters(frames, staging.numpy(), staging, device, ends_host, ends)
            slot.by_frames[frames] = call
        return call.host

    def submit(self, frames: int, span: tuple[int, int], keep: Any = None, defer: bool = False) -> Pending:
        """Launches the call whose `parameters` are filled. keep: what must live until it is done.

        defer: its events are put in order beside the listing of the next call's, or when somebody wants them.
        """
        slot = self._slots[self._serial % self._calls]
        slot.serial = self._serial
        slot.pending = pending = Pending(self._collect, self._serial, frames, span, keep)
        self._serial += 1
        if not defer:
            self._put_in_order()
            self._launch(slot)
            return pending
        slot.begin()
        before, self._unordered = self._unordered, slot
        if before is None:
            self._replay(slot.call, "list", lambda: self._list(slot))
        else:
            other = before
            self._replay(slot.call, other.call, lambda: self._list_beside(slot, other))
            self._mark(other)
        return pending

    def _launch(self, slot: Slot) -> None:
        """Launches all of a call."""
        slot.begin()
        self._replay(slot.call, "all", lambda: self._list_and_order(slot))
        self._mark(slot)

    def _put_in_order(self) -> None:
        """Launches what is still to be done of the last call."""
        slot, self._unordered = self._unordered, None
        if slot is not None:
            self._replay(slot.call, "order", lambda: self._order_events(slot))
            self._mark(slot)

    def _mark(self, slot: Slot) -> None:
        """Records that behind what has been launched its events are in order."""
        if slot.event is not None:
            self._device.stream.record_event(slot.event)

    def _replay(self, call: CallParameters, name: Any, enqueue: Callable[[], Any]) -> None:
        """Enqueues it the first time, records it the second, and launches the graph from then on."""
        if not self.records or name not in call.graphs:
            enqueue()
            call.graphs[name] = None
            return
        if call.graphs[name] is None:
            with wp.ScopedCapture(self._device) as capture:
                enqueue()
            call.graphs[name] = capture.graph
        wp.capture_launch(call.graphs[name], self._device.stream)

    def _list(self, slot: Slot) -> None:
        call, filled = slot.call, self._order.filled[slot.number % 2]
        before = self._slots[slot.number - 1].counters
        wp.copy(call.device, call.staging)
        self._source.find(self._sensor, call.device, call.frames, filled, slot.counters, before)
        self._source.sense(self._sensor, call.device, call.frames, slot.keys, slot.counters)

    def _order_events(self, slot: Slot) -> None:
        # The next call's counters are in use where its events are listed already.
        following = self._slots[(slot.number + 2) % self._calls].counters
        self._order.launch(
            self._sensor, slot.call.device, slot.call.frames, slot.keys, slot.counters, following, slot.head,
            slot.columns, slot.call.ends, slot.number % 2,
        )  # fmt: skip

    def _list_and_order(self, slot: Slot) -> None:
        self._list(slot)
        self._order_events(slot)

    def _list_beside(self, slot: Slot, other: Slot) -> None:
        """Lists the events of one call while those of another are put in order."""
        if self._aside is None:
            self._order_events(other)
            self._list(slot)
            return
        stream = self._device.stream
        self._aside.wait_event(stream.record_event(self._fork))
        with wp.ScopedStream(self._aside, sync_enter=False):
            self._order_events(other)
        self._list(slot)
        stream.wait_event(self._aside.record_event(self._join))

    def _collect(self, pending: Pending) -> DeviceEvents:
        """Completes every call up to this one."""
        while self._collected <= pending.serial:
            slot = self._slots[self._collected % self._calls]
            assert slot.pending is not None
            if slot is self._unordered:
                self._put_in_order()
            if slot.event is not None:
                wp.synchronize_event(slot.event)
            if slot.view[call_kernels.STATUS] != call_kernels.DONE:
                self._mend(slot, slot.pending)
            self._finish(slot, slot.pending)
            self._collected += 1
        assert pending.events is not None
        return pending.events

    def _finish(self, slot: Slot, pending: Pending) -> None:
        head, serial = slot.view, slot.serial
        offsets = head[call_kernels.OFFSETS :].copy()
        self._source.done()
        self._found(head[: len(COUNTERS)])
        if self._order.widen(int(head[0])):
            self._forget()
        ends = None
        if self._envs == 1:
            ends = slot.call.stamps.copy(), slot.call.ends_host.numpy().copy()
        pending.events = DeviceEvents(
            slot.named, int(head[0]), offsets, pending.span, lambda: slot.serial == serial, ends, settled=True
        )  # fmt: skip
        pending.keep, pending.wrong = None, pending.problem()

    def _mend(self, slot: Slot, pending: Pending) -> None:
        """Completes a call that did not end on the device, by more room or another sort."""
        outgrown = slot.view[call_kernels.STATUS] == call_kernels.OUTGROWN
        if outgrown:
            self._put_in_order()
        while slot.view[call_kernels.STATUS] == call_kernels.OUTGROWN:
            self._make_room(slot)
        if slot.view[call_kernels.STATUS] == call_kernels.CROWDED:
            call, listed = slot.call, slot.view[: call_kernels.COUNTS]
            # As the host has them: the next call but one begins its own in the place of these.
            counters: wp.array = wp.array(listed, dtype=wp.int64, device=self._device)
            self._order.sort(
                self._sensor, self._layout, call.device, pending.span, call.frames, slot.keys, counters,
                int(listed[0]), slot.crowds(), slot.columns, call.ends,
            )  # fmt: skip
            wp.synchronize_device(self._device)
        if outgrown:
            # Those after it did nothing.
            for serial in range(pending.serial + 1, self._serial):
                self._launch(self._slots[serial % self._calls])

    def _make_room(self, slot: Slot) -> None:
        """Makes a longer list, and goes on with the call."""
        wp.synchronize_device(self._device)
        # A call after it, in doing nothing, may have written over the counters themselves.
        counters, keys = slot.view[: call_kernels.COUNTS].copy(), slot.keys
        wanted, kept = int(counters[0]), min(int(counters[call_kernels.FULL_FROM]), keys.size)
        self.grow(wanted + max(wanted // 4, LEAST_ROOM))
        if self._source.repeats:
            counters, kept = fresh_counters(), 0
        wp.copy(slot.keys, keys, count=kept)
        counters[0], counters[call_kernels.FULL_FROM] = kept, call_kernels.NOT_FULL
        slot.counters.assign(counters)
        slot.begin()
        self._order.filled[slot.number % 2].zero_()
        self._source.sense(self._sensor, slot.call.device, slot.call.frames, slot.keys, slot.counters)
        self._order_events(slot)
        wp.synchronize_device(self._device)
