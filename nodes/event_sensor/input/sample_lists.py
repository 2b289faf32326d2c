"""Takes the further samples of messages onto a sensor's device, and checks them."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from nodes.event_sensor.input.batch import SampleLists, Size
from nodes.event_sensor.input.further import Further, checked, problem


class SampleInput:
    """Takes further samples of a sensor's messages.

    size, device: of the sensor. refused: why it takes none, "" where it does. calls: that may be under way at once on a
    GPU.
    """

    def __init__(self, size: Size, device: Any, refused: str, calls: int) -> None:
        self._size, self._device, self._refused, self._calls = size, device, refused, calls
        self._told: list[wp.array] = []
        """Where a GPU says what it has found."""

    def take(self, further: Further, t: np.ndarray, t_base: int, fresh: np.ndarray, waits: bool) -> SampleLists | None:
        """Checks the samples of a message; gives None without any.

        Args:
            further: of the message.
            t: int64 [K] ns, stamps of its frames.
            t_base: where offsets are 0 [ns].
            fresh: bool [E], environments that begin an episode with the first frame.
            waits: for what is found; else samples are not read where they are wrong, and `problem` tells it later.

        Raises ValueError.
        """
        if self._refused:
            raise ValueError(f"event sensor got further samples between the frames, but {self._refused}")
        told = None
        if self._device.is_cuda:
            if not self._told:
                self._told = [wp.zeros(1, dtype=wp.int64, device="cpu", pinned=True) for _ in range(self._calls + 1)]
            # In turns, for as many calls may be under way.
            self._told.append(told := self._told.pop(0))
        lists = checked(further.on(self._size, self._device), self._size, t, t_base, fresh, told)
        if not waits:
            return lists
        if self._device.is_cuda:
            wp.synchronize_stream(self._device.stream)
        if wrong := problem(lists, self._size):
            raise ValueError(wrong)
        return lists if lists.offset.size else None
