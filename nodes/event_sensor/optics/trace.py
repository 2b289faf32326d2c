"""Computes the photoreceptor's output between samples, with as many samples of its own as lines between them need."""

from __future__ import annotations

from typing import Any

import warp as wp

from nodes.event_sensor.input.batch import SampleLists
from nodes.event_sensor.input.between_kernels import between
from nodes.event_sensor.input.limit import MOST_NUMBERED
from nodes.event_sensor.optics import trace_kernels as kernels
from nodes.event_sensor.optics.photoreceptor_simd_kernels import Receptor
from nodes.event_sensor.optics.trace_line_kernels import Output

FIRST_ROOM = 4096


class Tracer:
    """Traces the output of a photoreceptor; see Photoreceptor.trace."""

    def __init__(self, poles: int, law: int, receptor: Receptor, chord: float, device: Any) -> None:
        """Makes the kernel and its buffers. chord: largest deviation of a line between samples [ln I]."""
        self._receptor, self._chord, self._device = receptor, chord, device
        self._kernel = (kernels.make_trace_or_count if device.is_cuda else kernels.make_trace_bent)(poles, law)
        self._output: Any = Output()
        self._first: wp.array = wp.zeros(1, dtype=wp.int32, device=device)
        self._before: list[wp.array] = []
        self.filtered: wp.array = wp.empty(0, dtype=wp.float32, device=device)
        self.bent: wp.array = wp.empty(0, dtype=wp.uint8, device="cpu")
        """On a CPU: the pixels whose output may be no line between samples."""
        self._grow(FIRST_ROOM)

    def _grow(self, room: int) -> None:
        if room > MOST_NUMBERED:
            raise ValueError(f"the photoreceptor makes {room} samples in one message; give it shorter ones")
        self._output.room = room
        self._output.offset = wp.empty(room, dtype=wp.int32, device=self._device)
        self._output.value = wp.empty(room, dtype=wp.float32, device=self._device)

    def begin(self, images: wp.array, state: list[wp.array]) -> None:
        """Keeps the state before a message, last sample and poles, and makes room for its flat frames."""
        pixels = state[0].size
        if self.filtered.size != images.size:
            self.filtered = wp.empty(images.size, dtype=wp.float32, device=self._device)
        if self._first.size != pixels + 1:
            self._first = wp.zeros(pixels + 1, dtype=wp.int32, device=self._device)
        if not self._device.is_cuda:
            self._before = [wp.clone(values) for values in state]
            self.bent = wp.zeros(pixels, dtype=wp.uint8, device="cpu")

    def trace(
        self, images: wp.array, lists: SampleLists | None, stamps: wp.array, fresh: wp.array, state: list[wp.array]
    ) -> SampleLists | None:
        """Returns further samples of the output; `filtered` are its frames, which on a CPU were filtered before.

        stamps: int64 [K], after the message's start [ns]. state: moves on.
        """
        inputs = [self._receptor, self._chord, fresh, stamps, images, between(lists)]
        count = (self._on_gpu if self._device.is_cuda else self._on_cpu)(inputs, state)
        output = self._output
        return SampleLists(self._first, output.offset[:count], output.value[:count], 1) if count else None

    def _on_cpu(self, inputs: list[Any], state: list[wp.array]) -> int:
        inputs = [*inputs, self.bent, *self._before]
        while True:
            outputs = [self.filtered, self._first, self._output]
            wp.launch(self._kernel, state[0].size, [*inputs, *state], outputs, device="cpu")
            count = int(self._first.numpy()[-1])
            if count <= self._output.room:
                return count
            self._grow(count + count // 4)  # and once more, from the state before

    def _on_gpu(self, inputs: list[Any], state: list[wp.array]) -> int:
        counts = self._first[1:]
        for writes in (False, True):
            outputs = [self.filtered, counts, self._output]
            wp.launch(self._kernel, state[0].size, [*inputs, writes, self._first, *state], outputs, device=self._device)
            if not writes:
                wp.utils.array_scan(counts, counts, inclusive=True)
                count = int(self._first[-1:].numpy()[0])
                if count > self._output.room:
                    self._grow(count + count // 4)
        return count
