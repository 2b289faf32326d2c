"""Implements the engine of the paper's equations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp

from evis.gpu.building import LAUNCH_BLOCK
from nodes.event_sensor.input.batch import Batch, Size
from nodes.event_sensor.model import paper_kernels
from nodes.event_sensor.model.faults.fixed_pattern import pattern_of
from nodes.event_sensor.model.sensor_kernels import Sensor

PATTERN = ("c_on", "c_off", "leak_rate", "hot_rate")
"""What the kernel reads of the fixed pattern, in its order; an empty array stands for what pixels do not differ in."""


class PaperEngine:
    """Implements an Engine for equations (3) and (4) as they stand."""

    sorts = False

    def __init__(self, size: Size, seed: int, p: Mapping[str, Any], device: Any) -> None:
        total = size.envs * size.pixels
        row = size.width * size.channels
        self._columns = 1 if device.is_cuda else row
        self._threads = (size.envs, size.height, row // self._columns)
        self._device, self.in_place = device, False
        pattern = pattern_of(size, seed, p)
        none = np.zeros(0, np.float32)
        self._pattern: tuple[wp.array, ...] = tuple(
            wp.array(pattern.get(name, none), dtype=wp.float32, device=device) for name in PATTERN
        )
        self._before: wp.array = wp.zeros(total, dtype=paper_kernels.PaperPixel, device=device)
        self._after: wp.array = wp.zeros(total, dtype=paper_kernels.PaperPixel, device=device)

    def arrays(self) -> tuple[wp.array, ...]:
        """Returns all arrays of the pixels' state."""
        return self._before, self._after, *self._pattern

    def present(self) -> dict[str, wp.array]:
        """Names the arrays that the next call goes on from; the pattern is that of the seed."""
        return {"pixel": self._before}

    def kernels(self) -> list[tuple[wp.Kernel, int]]:
        """Gives the kernel that is launched, as `build_together` takes it."""
        return [(paper_kernels.paper, LAUNCH_BLOCK)]

    def launch(self, sensor: Sensor, batch: Batch, keys: wp.array, counters: wp.array, resume: int) -> None:
        """Writes events of a batch to `keys`, as many as fit; all are counted."""
        b = batch
        wp.launch(
            paper_kernels.paper,
            self._threads,
            [sensor, b.begin, b.episodes, b.images, b.t, b.t_base, self._columns, *self._pattern, self._before],
            [self._after, keys, counters],
            device=self._device,
        )

    def swap(self) -> None:
        self._before, self._after = self._after, self._before
