"""Where the events of several messages that were sensed at once are cut apart."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from nodes.event_sensor.cuda.cut_kernels import count_up_to

MOST = 1 << 10
"""Messages of a call."""


class Cuts:
    """Finds where messages end in events that are on a device and done, beside what the device does meanwhile."""

    def __init__(self, device: Any) -> None:
        self._device = device
        self._stream = wp.Stream(device) if device.is_cuda else None
        self._host: list[wp.array] = [
            wp.zeros(MOST, dtype=dtype, device="cpu", pinned=device.is_cuda) for dtype in (wp.int64, wp.int32)
        ]
        # The device reads and writes the host's memory itself.
        self._there: list[wp.array] = [
            wp.array(ptr=array.ptr, shape=(MOST,), dtype=array.dtype, device=device) for array in self._host
        ]
        self.of(wp.zeros(1, dtype=wp.int64, device=device), [0])  # loads the kernel

    def of(self, t: wp.array, ends: Sequence[int]) -> list[int]:
        """Counts, of ascending times int64 [n] ns, those before or at each end [ns]."""
        ends_of, counts = (array.numpy() for array in self._host)
        ends_of[: len(ends)] = np.array(ends, np.int64)
        if self._stream is None:
            wp.launch(count_up_to, len(ends), [t, self._there[0]], [self._there[1]], device=self._device)
        else:
            with wp.ScopedStream(self._stream, sync_enter=False):
                wp.launch(count_up_to, len(ends), [t, self._there[0]], [self._there[1]], device=self._device)
            wp.synchronize_stream(self._stream)
        return [int(count) for count in counts[: len(ends)]]
