"""Runs a codec's Warp kernel (one CPU thread) over a buffer of words."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

import numpy as np

from evis.events.arrays import Triggers
from evis.events.codecs.buffer import EventBuffer

if TYPE_CHECKING:
    import warp as wp

_TRIGGERS = 1 << 14
_SIDE = 1 << 18
# places of the kernels' parameters
_WORDS, _SPAN, _SINK = range(3)


def _point_to(array: Any, address: int, length: int) -> None:
    """Lets an array parameter of a recorded launch point to other memory of its type."""
    array.data = address
    array.shape[0] = length


class WarpLauncher:
    """Launches one kernel with its scratch memory: at most `_TRIGGERS` triggers and `_SIDE` side words a launch.

    kernel: `module:function`. side: the kernel also takes side arrays (time int64 [us], word uint16). The launch is
    recorded once; after that only addresses and lengths change, for packing arguments anew costs 0.1 ms.
    """

    def __init__(self, kernel: str, side: bool) -> None:
        from evis.events.codecs import warp_calls

        module, _, name = kernel.partition(":")
        self._calls, self._kernel = warp_calls, getattr(importlib.import_module(module), name)
        self._out = np.zeros(5, np.int64)
        self._edges = [np.empty(_TRIGGERS, d) for d in (np.int64, np.uint8, np.uint8)]
        self._side = [np.empty(_SIDE if side else 0, d) for d in (np.int64, np.uint16)]
        self._command: wp.Launch | None = None
        self._words: np.ndarray | None = None
        self._state: np.ndarray | None = None

    def load(self, words: np.ndarray) -> None:
        """Sets the buffer that the next runs read, and holds it. Unaligned buffers are copied."""
        self._words = np.require(words, requirements=["C", "A"])
        if self._command is not None:
            _point_to(self._command.params[1 + _WORDS], self._words.__array_interface__["data"][0], len(self._words))

    def _record(self, state: np.ndarray, buffer: EventBuffer) -> wp.Launch:
        if self._words is None:
            raise ValueError("no words were loaded")
        sink = self._calls.sink(state, self._out, *buffer.columns, *self._edges, *self._side)
        return self._calls.record(self._kernel, [self._calls.view(self._words), self._calls.Span()], [sink])

    def run(
        self, at: int, limit: int, readout: tuple[int, int], transposed: bool, state: np.ndarray, buffer: EventBuffer
    ) -> tuple[Triggers | None, tuple[np.ndarray, np.ndarray] | None, int, int]:
        """Decodes from word `at` on, and appends to `buffer` as far as it has room. readout: columns and rows of the
        words.

        Returns triggers and side words (time, word) where there are any, the word to go on with, and the time at the
        cut or -1.
        """
        command = self._command
        if command is None:
            command = self._command = self._record(state, buffer)
            self._span, self._sink = command.params[1 + _SPAN], command.params[1 + _SINK]
        if state is not self._state:
            self._state = state
            _point_to(self._sink.state, state.__array_interface__["data"][0], len(state))
        span = self._span
        span.start, span.limit_us, span.width, span.height = at, limit, *readout
        filled, room = buffer.n, buffer.capacity - buffer.n
        sink = self._sink
        columns = (sink.t, sink.y, sink.x, sink.p) if transposed else (sink.t, sink.x, sink.y, sink.p)
        for column, (address, size) in zip(columns, buffer.places):
            _point_to(column, address + filled * size, room)
        command.launch()
        at, n, m, following, k = self._out.tolist()
        buffer.n += n
        triggers = Triggers(*(a[:m].copy() for a in self._edges)) if m else None
        side = (self._side[0][:k].copy(), self._side[1][:k].copy()) if k else None
        return triggers, side, at, following
