"""Implements the engine of the ideal sensor on a CPU: its state, and the lists that take its events."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from nodes.event_sensor.cpu.ideal_kernels import (
    AT_STEP,
    FULL,
    GROUP,
    JOINS,
    NEEDED,
    OUTGROWN,
    STATUS,
    STEP,
    Lists,
    make_sense_ideal,
)
from nodes.event_sensor.cpu.simd_kernels import IdealState, room_for_block
from nodes.event_sensor.input.batch import Batch, SampleLists
from nodes.event_sensor.model.keys import KeyLayout
from nodes.event_sensor.model.sensor_kernels import EVENTS, LEFT, Sensor
from nodes.event_sensor.model.state_kernels import Reference

FIRST_ROOM = 4096
"""Events for which a list has room at first."""


class StepLists:
    """Holds a list of keys for each step of a group, and one to sort in; they grow one by one."""

    def __init__(self) -> None:
        self.kernel: Any = Lists()
        self._keys = [np.empty(FIRST_ROOM, np.int64) for _ in range(GROUP)]
        self._addresses = np.array([keys.ctypes.data for keys in self._keys], np.uint64)
        self._room = np.full(GROUP, FIRST_ROOM, np.int64)
        self._taken = np.zeros(GROUP, np.int64)
        self.kernel.keys = wp.array(self._addresses, dtype=wp.uint64, device="cpu", copy=False)
        self.kernel.room = wp.array(self._room, dtype=wp.int64, device="cpu", copy=False)
        self.kernel.taken = wp.array(self._taken, dtype=wp.int64, device="cpu", copy=False)
        self._spare_for(FIRST_ROOM)

    def _spare_for(self, room: int) -> None:
        self._spare = np.empty(room, np.int64)
        self.kernel.spare = self._spare.ctypes.data

    def empty(self) -> None:
        """Forgets all events."""
        self._taken[:] = 0

    def grow(self, step: int, needed: int) -> None:
        """Makes room for this many events in the list of a step."""
        room = max(needed, 2 * len(self._keys[step]))
        keys = np.empty(room, np.int64)
        taken = self._taken[step]
        keys[:taken] = self._keys[step][:taken]
        self._keys[step], self._addresses[step], self._room[step] = keys, keys.ctypes.data, room
        if room > len(self._spare):
            self._spare_for(room)


class IdealEngine:
    """Implements an Engine for linear or frame stamps and no fault, on a CPU; on a GPU cuda.ideal does the same."""

    sorts = True
    """Its keys come in order."""

    def __init__(self, total: int, frame: bool, layout: KeyLayout) -> None:
        """Makes the buffers. total: pixels and channels of all environments. frame: events carry the stamp of their
        frame. layout: of their keys."""
        self._kernel, self._frame, self._layout = make_sense_ideal(frame), frame, layout
        self._none: wp.array = wp.zeros(0, dtype=wp.int32, device="cpu")
        self._further: Any = None
        self._state: Any = IdealState()
        self._state.last = wp.zeros(total, dtype=wp.float32, device="cpu")
        self._state.low = wp.full(total, float("inf"), dtype=wp.float32, device="cpu")
        self._state.high = wp.zeros(total, dtype=wp.float32, device="cpu")
        self._state.level = wp.zeros(total, dtype=Reference, device="cpu")
        self._work = room_for_block()
        self._lists = StepLists()
        self._progress = np.zeros(AT_STEP + 1, np.int64)
        self._progress_there: wp.array = wp.array(self._progress, dtype=wp.int64, device="cpu", copy=False)

    def kernels(self) -> list[tuple[wp.Kernel, int]]:
        """Gives the kernel that is launched, as `build_together` takes it; for further samples there is another."""
        return [(self._kernel, 1)]

    def arrays(self) -> tuple[wp.array, ...]:
        """Returns all arrays of the pixels' state."""
        return self._state.last, self._state.low, self._state.high, self._state.level

    def present(self) -> dict[str, wp.array]:
        """Names the arrays that the next call goes on from."""
        return {name: getattr(self._state, name) for name in ("last", "low", "high", "level")}

    def launch(self, sensor: Sensor, batch: Any, keys: wp.array, counters: wp.array, resume: int) -> None:
        """Writes the events of a batch to `keys`, as many as fit; resume > 0: go on where the last launch found them
        full."""
        if not resume:
            self._progress[:] = 0
            self._lists.empty()
        lists = batch.further
        inputs = [sensor, batch.images, batch.t, batch.t_base, batch.begin]
        inputs += [self._none, 1] if lists is None else [lists.first, lists.shared]
        kernel = self._kernel if lists is None else make_sense_ideal(self._frame, True)
        while self._progress[STATUS] != JOINS:
            kept = [self._state, self._work, self._lists.kernel, self._progress_there]
            wp.launch(kernel, 1, [*inputs, *kept], [keys, counters], device="cpu")
            if self._progress[STATUS] == FULL:
                counters.numpy()[-1] = self._progress[NEEDED]
                return
            if self._progress[STATUS] != OUTGROWN:
                break
            self._lists.grow(int(self._progress[STEP]), int(self._progress[NEEDED]))
        if lists is not None:
            self._join(sensor, batch, lists, keys, counters.numpy())

    def _join(self, sensor: Sensor, batch: Batch, lists: SampleLists, keys: wp.array, counters: np.ndarray) -> None:
        """Adds the events of the pixels with further samples, once there is room for all."""
        if self._further is None:
            from nodes.event_sensor.cpu.further import FurtherPixels

            self._further = FurtherPixels(self._layout)
        if self._progress[STATUS] != JOINS:
            self._further.sense(sensor, batch, lists, self._state, counters)
            self._progress[STATUS] = JOINS
        count, more = int(counters[EVENTS]), len(self._further.keys)
        if count + more > sensor.capacity:
            counters[LEFT] = count + more
            return
        self._further.join(keys, count)
        counters[EVENTS] += more

    def swap(self) -> None:
        """Keeps the state, which is changed in place."""
