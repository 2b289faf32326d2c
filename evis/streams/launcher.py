"""Runs a codec's Warp kernel (one CPU thread) over a buffer of words."""

from __future__ import annotations

import importlib

import numpy as np

from evis.streams.events import Events, Triggers

_SCRATCH = 1 << 19
"""Events that one kernel launch may give: 6.8 MB of scratch."""
_TRIGGERS = 1 << 14
_SIDE = 1 << 18


class WarpLauncher:
    """One kernel with its scratch: at most `_SCRATCH` events, `_TRIGGERS` triggers and `_SIDE` side words a launch.

    kernel: `module:function`. side: the kernel also takes side arrays (time int64 [us], word uint16).
    """

    def __init__(self, kernel: str, side: bool) -> None:
        from evis.streams import kernels

        module, _, name = kernel.partition(":")
        self._kernels, self._kernel = kernels, getattr(importlib.import_module(module), name)
        self._out = np.zeros(5, np.int64)
        self._scratch = [np.empty(_SCRATCH, d) for d in (np.int64, np.uint16, np.uint16, np.uint8)]
        self._edges = [np.empty(_TRIGGERS, d) for d in (np.int64, np.uint8, np.uint8)]
        self._side = [np.empty(_SIDE if side else 0, d) for d in (np.int64, np.uint16)]
        used = [self._out, *self._scratch, *self._edges, *(self._side if side else [])]
        self._outputs = [kernels.view(a) for a in used]
        self._words: np.ndarray | None = None

    def load(self, words: np.ndarray) -> None:
        """The buffer that the next runs read; kept alive here. Unaligned buffers are copied."""
        self._words = np.require(words, requirements=["A"])
        self._input = self._kernels.view(self._words)

    def run(
        self, at: int, limit: int, width: int, height: int, state: np.ndarray
    ) -> tuple[Events, tuple[np.ndarray, np.ndarray], int, int]:
        """Decode from word `at`: events, side words (time, word), the word to go on with, time at the cut or -1."""
        self._kernels.launch(self._kernel, [self._input, at, limit, width, height], [state, *self._outputs])
        at, n, m, following, k = (int(v) for v in self._out)
        t, x, y, p = (a[:n].copy() for a in self._scratch)
        triggers = Triggers(*(a[:m].copy() for a in self._edges)) if m else Triggers()
        side = (self._side[0][:k].copy(), self._side[1][:k].copy())
        return Events(t, x, y, p, triggers=triggers), side, at, following
