"""Puts a call's events in order, and holds the buffers for it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import warp as wp

from nodes.event_sensor.cuda import order_kernels, sort_kernels
from nodes.event_sensor.model.keys import KeyLayout
from nodes.event_sensor.model.sensor_kernels import Sensor

BUCKETS, MOST_BUCKETS = 1 << 11, 1 << 15
"""To begin with, and where calls have many events."""
SOME, MANY = 256, 512
"""Events of a bucket, on average, for which buckets are made, and from which more buckets are worth their cost,"""
OFTEN = 3
"""if so many calls in a row have them."""
THREADS = 1 << 22
"""Most that share a list: many more than a GPU holds at once, so that none is left to the last ones."""
SCAN = 1024
"""Threads that find where buckets begin."""


class Order:
    """Sorts up to what is in `keys` by environment, t, y, x. stamped: most events have the stamp of their frame."""

    def __init__(self, envs: int, stamped: bool, device: Any) -> None:
        self._envs, self._stamped, self._device = envs, stamped, device
        self._crowds = self._room = 0
        self._make(max(BUCKETS // envs, 1))

    def _make(self, of_env: int) -> None:
        self._of_env, self._length = of_env, self._envs * of_env
        # Two of each: a call's events are put in order while the next call's are listed.
        # Empty from the start: those of a call whose events are listed already are counted into the new ones.
        self.filled = [wp.zeros(self._length, dtype=wp.int32, device=self._device) for _ in range(2)]
        self._first = [self._empty(self._length + 1) for _ in range(2)]

    def kernels(self) -> list[tuple[wp.Kernel, int]]:
        """Lists the kernels that put events in order, one for each block size, as `build_together` takes them."""
        return [(order_kernels.place_buckets, SCAN), (order_kernels.in_order, sort_kernels.BLOCK)]

    def _empty(self, length: int, dtype: Any = wp.int32) -> wp.array:
        return wp.empty(length, dtype=dtype, device=self._device)

    def reserve(self, capacity: int) -> None:
        """Makes room for so many events in a call."""
        if capacity > self._room:
            self._room = capacity
            self._slots = [self._empty(capacity) for _ in range(2)]
            self._buckets = [self._empty(capacity, wp.int64) for _ in range(2)]

    def launch(
        self, sensor: Sensor, call: wp.array, frames: int, keys: wp.array, counters: wp.array, following: wp.array,
        head: wp.array, columns: Any, ends: wp.array, side: int,
    ) -> None:  # fmt: skip
        """Puts the listed events in order, writes the columns, and the head.

        Args:
            sensor, call, frames, keys, counters: as in source.Source.
            following: counters that are made ready for a later call, int64 [COUNTS].
            head: what the host wants to know, int64, see call_kernels.
            columns: key_kernels.Columns.
            ends: of one environment, events up to the stamp of each frame, int64 [K], written.
            side: which buckets, 0 or 1.
        """
        filled, first, slots, buckets = self.filled[side], self._first[side], self._slots[side], self._buckets[side]
        threads = min(THREADS, max(keys.size, 1))
        given = [sensor, call, frames, self._stamped, self._of_env, threads]
        wp.launch(order_kernels.count_events, threads, [*given, keys, counters], [filled, slots], device=self._device)
        wp.launch_tiled(
            order_kernels.place_buckets,
            dim=[1],
            inputs=[sensor, self._of_env, filled, counters],
            outputs=[first, following, head],
            block_dim=SCAN,
            device=self._device,
        )
        listed = [*given, keys, counters, slots, first]
        wp.launch(order_kernels.to_buckets, threads, listed, [buckets, columns.t], device=self._device)
        wp.launch_tiled(
            order_kernels.in_order,
            dim=[self._length],
            inputs=[sensor, call, counters, first, buckets],
            outputs=[columns],
            block_dim=sort_kernels.BLOCK,
            device=self._device,
        )
        self._find_ends(sensor, call, frames, counters, columns, ends)

    def sort(
        self, sensor: Sensor, layout: KeyLayout, call: wp.array, span: tuple[int, int], frames: int, keys: wp.array,
        counters: wp.array, count: int, crowds: Sequence[tuple[int, int]], columns: Any, ends: wp.array,
    ) -> None:  # fmt: skip
        """Puts events of crowded buckets in order by a radix sort, whose length the host knows.

        Args:
            sensor, call, frames, keys, columns, ends: as of `launch`, which was before.
            layout: of the keys.
            span: the call's start and last stamp [ns].
            counters: int64 [COUNTS] of the call, as they were when its events were listed.
            count: events in the list.
            crowds: of each crowded bucket its first event and their number; none where there are too many to be known.
        """
        bits = layout.t + (span[1] - span[0]).bit_length()
        for first, length in crowds or [(0, count)]:
            pairs: wp.array = wp.empty(2 * length, dtype=wp.int64, device=self._device)
            wp.copy(pairs, columns.t if crowds else keys, src_offset=first, count=length)
            nothing: wp.array = wp.empty(2 * length, dtype=wp.int32, device=self._device)
            wp.utils.radix_sort_pairs(pairs, nothing, length, 0, bits)
            if self._envs > 1 and not crowds:
                wp.utils.radix_sort_pairs(pairs, nothing, length, layout.env, 63)
            inputs = [sensor, span[0], pairs, first]
            wp.launch(order_kernels.unpack_sorted, length, inputs, [columns], device=self._device)
        self._find_ends(sensor, call, frames, counters, columns, ends)

    def _find_ends(
        self, sensor: Sensor, call: wp.array, frames: int, counters: wp.array, columns: Any, ends: wp.array
    ) -> None:
        if self._envs == 1:
            given = [sensor, call, counters, columns.t]
            wp.launch(order_kernels.find_ends, frames, given, [ends], device=self._device)

    def widen(self, count: int) -> bool:
        """Makes more buckets where calls had many events, often; returns True when their arrays are new.

        count: events of the call that is done.
        """
        self._crowds = self._crowds + 1 if count > self._length * MANY else 0
        if self._crowds < OFTEN or 2 * self._length > MOST_BUCKETS:
            return False
        wanted = min(1 << (count // SOME - 1).bit_length(), MOST_BUCKETS)
        self._make(wanted // self._envs)
        return True
