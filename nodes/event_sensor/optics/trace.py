"""The photoreceptor's output between samples, with as many samples of its own as lines between them need."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from nodes.event_sensor.batch import SampleLists
from nodes.event_sensor.model.step_kernels import between
from nodes.event_sensor.optics import trace_kernels as kernels
from nodes.event_sensor.optics.photoreceptor_simd_kernels import Receptor

FIRST_ROOM = 4096


class Tracer:
    """Traces the output of a photoreceptor; see Photoreceptor.trace."""

    def __init__(self, poles: int, varying: bool, receptor: Receptor, chord: float, device: Any) -> None:
        """chord: largest deviation of a line between samples [ln I]."""
        self._receptor, self._chord, self._device = receptor, chord, device
        self._kernel = (kernels.tracing_gpu if device.is_cuda else kernels.tracing)(poles, varying)
        self._output: Any = kernels.Output()
        self._first: wp.array | None = None
        self._filtered: wp.array | None = None
        self._grow(FIRST_ROOM)

    def _grow(self, room: int) -> None:
        if room >= 1 << 31:
            raise ValueError(f"the photoreceptor makes {room} samples in one message; give it shorter ones")
        self._output.room = room
        self._output.offset = wp.empty(room, dtype=wp.int32, device=self._device)
        self._output.value = wp.empty(room, dtype=wp.float32, device=self._device)

    def __call__(
        self, images: wp.array, lists: SampleLists | None, stamps: wp.array, fresh: wp.array, state: list[wp.array]
    ) -> tuple[wp.array, SampleLists | None]:
        """Returns frames and further samples. images: flat. stamps: int64 [K], after the message's start [ns]. state:
        last sample and poles, which move on."""
        pixels = state[0].size
        if self._filtered is None or self._filtered.size != images.size:
            self._filtered = wp.empty(images.size, dtype=wp.float32, device=self._device)
        if self._first is None:
            self._first = wp.zeros(pixels + 1, dtype=wp.int32, device=self._device)
        inputs = [self._receptor, self._chord, fresh, stamps, images, between(lists)]
        count = (self._on_gpu if self._device.is_cuda else self._on_cpu)(inputs, state, pixels)
        output = self._output
        traced = SampleLists(self._first, output.offset[:count], output.value[:count], 1) if count else None
        return self._filtered, traced

    def _on_cpu(self, inputs: list[Any], state: list[wp.array], pixels: int) -> int:
        assert self._first is not None
        before = [np.array(values.numpy()) for values in state]
        while True:
            outputs = [self._filtered, self._first, self._output]
            wp.launch(self._kernel, pixels, [*inputs, *state], outputs, device="cpu")
            count = int(self._first.numpy()[-1])
            if count <= self._output.room:
                return count
            # Once more, from the state before, with room for all.
            self._grow(count + count // 4)
            for values, old in zip(state, before):
                values.numpy()[:] = old

    def _on_gpu(self, inputs: list[Any], state: list[wp.array], pixels: int) -> int:
        assert self._first is not None
        counts = self._first[1:]
        for writes in (False, True):
            outputs = [self._filtered, counts, self._output]
            wp.launch(self._kernel, pixels, [*inputs, writes, self._first, *state], outputs, device=self._device)
            if not writes:
                wp.utils.array_scan(counts, counts, inclusive=True)
                count = int(self._first[-1:].numpy()[0])
                if count > self._output.room:
                    self._grow(count + count // 4)
        return count
