"""Where a call's events are put in order, and the buffers for it."""

from __future__ import annotations

from typing import Any

import warp as wp

from nodes.event_sensor.cuda import order_kernels
from nodes.event_sensor.model.keys import KeyLayout
from nodes.event_sensor.model.sensor_kernels import Sensor

BUCKETS = 1 << 9
"""To begin with."""
MOST_BUCKETS = 1 << 12
CROWD = 512
"""Events of a bucket, on average, from which more buckets are worth their cost,"""
OFTEN = 3
"""if so many calls in a row have them."""
THREADS = 1 << 16
BLOCK = 512


class Order:
    """Sorts up to what is in `keys` by environment, t, y, x. stamped: most events have the stamp of their frame."""

    def __init__(self, envs: int, stamped: bool, device: Any) -> None:
        self._envs, self._stamped, self._device = envs, stamped, device
        self._crowds = 0
        self._make(max(BUCKETS // envs, 1))

    def _make(self, of_env: int) -> None:
        self._of_env, self._length = of_env, self._envs * of_env
        room = self._length * order_kernels.BUCKET
        # Two of each: a call's events are put in order while the next call's are listed.
        self.filled = [wp.zeros(self._length, dtype=wp.int32, device=self._device) for _ in range(2)]
        self._buckets = [wp.empty(room, dtype=wp.int64, device=self._device) for _ in range(2)]

    def launch(
        self, sensor: Sensor, call: wp.array, frames: int, keys: wp.array, counters: wp.array, following: wp.array,
        head: wp.array, columns: Any, side: int,
    ) -> None:  # fmt: skip
        """Puts the listed events in order, writes the columns, and the head.

        Args:
            sensor, call, frames, keys, counters: as in pipeline.Source.
            following: counters that are made ready for a later call, int64 [COUNTS].
            head: what the host wants to know, int64, see call_kernels.
            columns: key_kernels.Columns.
            side: which buckets, 0 or 1.
        """
        filled, buckets = self.filled[side], self._buckets[side]
        threads = min(THREADS, max(keys.size, 1))
        wp.launch(
            order_kernels.to_buckets,
            threads,
            [sensor, call, frames, self._stamped, self._of_env, threads, keys, counters],
            [filled, buckets],
            device=self._device,
        )
        wp.launch_tiled(
            order_kernels.in_order,
            dim=[self._length],
            inputs=[sensor, call, self._of_env, filled, buckets, counters],
            outputs=[following, head, columns],
            block_dim=BLOCK,
            device=self._device,
        )

    def sort(
        self, sensor: Sensor, layout: KeyLayout, span: tuple[int, int], keys: wp.array, count: int, columns: Any
    ) -> None:
        """Does the same by a radix sort of the list, whose length the host knows: for times that crowd together.

        Args:
            sensor: its parameters.
            layout: of the keys.
            span: the call's start and last stamp [ns].
            keys: the list, int64 [capacity].
            count: events in it.
            columns: key_kernels.Columns, written.
        """
        pairs: wp.array = wp.empty(2 * count, dtype=wp.int64, device=self._device)
        wp.copy(pairs, keys, count=count)
        nothing: wp.array = wp.empty(2 * count, dtype=wp.int32, device=self._device)
        end = layout.t + (span[1] - span[0]).bit_length()
        wp.utils.radix_sort_pairs(pairs, nothing, count, 0, end)
        if self._envs > 1:
            wp.utils.radix_sort_pairs(pairs, nothing, count, layout.env, 63)
        inputs = [sensor, span[0], pairs]
        wp.launch(order_kernels.unpack_all, count, inputs, [columns], device=self._device)

    def widen(self, count: int) -> bool:
        """Makes more buckets where calls had many events, often; returns True when their arrays are new.

        count: events of the call that is done.
        """
        self._crowds = self._crowds + 1 if count > self._length * CROWD else 0
        if self._crowds < OFTEN or 2 * self._length > MOST_BUCKETS:
            return False
        self._make(2 * self._of_env)
        return True
