"""What all stream decoders share: bytes in pieces of any size, state carried between them, exact cuts in time."""

from __future__ import annotations

import abc
import importlib
from typing import ClassVar

import numpy as np

from evis.streams.events import Events, Triggers

FOREVER = 2**62
"""A limit [us] later than every time stamp."""
_SCRATCH = 1 << 19
"""Events that one kernel launch may give: 6.8 MB of scratch."""
_TRIGGERS = 1 << 14
NUMPY_BYTES = 16 << 20
"""Below this size numpy (5-10 Mev/s) is done before Warp would have been imported (about 1 s)."""

CODECS = {"evt2": "evis.streams.evt2", "evt3": "evis.streams.evt3"}


def backend_for(size: int) -> str:
    """`numpy` for small amounts of data [bytes], `warp` for large ones; both give the same bits."""
    return "numpy" if size <= NUMPY_BYTES else "warp"


def make_decoder(encoding: str, width: int = 0, height: int = 0, backend: str = "numpy") -> Decoder:
    """The decoder for `encoding`. Raises ValueError that lists the known ones."""
    if encoding not in CODECS:
        raise ValueError(f"the event encoding '{encoding}' is not supported; supported are {', '.join(sorted(CODECS))}")
    return importlib.import_module(CODECS[encoding]).Decoder(width, height, backend)


class Decoder(abc.ABC):
    """Words of one sensor to events. Feed bytes as they come, cut anywhere, also inside a word.

    width, height: events outside are dropped and counted in `outside`; 0 = unknown, nothing is dropped.
    backend: `numpy` or `warp` (a sequential CPU kernel); results and state are bit-equal.
    """

    encoding: ClassVar[str]
    word: ClassVar[np.dtype]
    wrap_ns: ClassVar[int]
    """The counter on the wire starts again after this time [ns]; the decoder counts the turns."""
    state_size: ClassVar[int]

    def __init__(self, width: int = 0, height: int = 0, backend: str = "numpy") -> None:
        if backend not in ("numpy", "warp"):
            raise ValueError(f"decoder backend is '{backend}', must be numpy or warp")
        self.width, self.height, self.backend = width, height, backend
        self._launcher: WarpLauncher | None = None
        self.reset()

    def reset(self) -> None:
        """Forget everything; needed after bytes were lost: events are dropped until the next TIME_HIGH."""
        self.state = np.zeros(self.state_size, np.int64)
        self._bytes: bytes | bytearray | memoryview = b""
        self._words = np.empty(0, self.word)
        self._at = 0
        self._fresh = True
        self._taken: tuple[int, int] = (0, 0)
        self.next_t_ns: int | None = None

    # -- counters ----------------------------------------------------------------------------------------------------

    @property
    @abc.abstractmethod
    def outside(self) -> int:
        """Events dropped because they lie outside width x height."""

    @property
    @abc.abstractmethod
    def untimed(self) -> int:
        """Words dropped because no time had been sent yet."""

    @property
    def pending(self) -> int:
        """Bytes fed and not yet decoded: whole words after a cut, or the first part of a word."""
        return len(self._bytes) - self._at * self.word.itemsize

    @property
    def at_cut(self) -> bool:
        """True when the last `decode_until` stopped at its limit, false when it needs more bytes."""
        return self._at < len(self._words)

    @property
    def taken(self) -> np.ndarray:
        """The wire bytes (uint8, a view) that the last call consumed; those of a started word come with its end."""
        return np.frombuffer(self._bytes, np.uint8)[self._taken[0] : self._taken[1]]

    # -- decoding ----------------------------------------------------------------------------------------------------

    def feed(self, data: bytes | bytearray | memoryview | np.ndarray) -> None:
        """Add bytes; what was pending comes first. The buffer must not change until it is decoded."""
        if isinstance(data, np.ndarray):
            data = np.ascontiguousarray(data).data.cast("B")
        left = self.pending
        if left:
            data = bytes(memoryview(self._bytes)[len(self._bytes) - left :]) + bytes(data)
        self._bytes, self._at, self._fresh = data, 0, True
        self._words = np.frombuffer(data, self.word, len(data) // self.word.itemsize)

    def decode(self, data: bytes | bytearray | memoryview | np.ndarray = b"") -> Events:
        """All events of what is pending and of `data`."""
        if len(data):
            self.feed(data)
        return self._decode(FOREVER)

    def decode_until(self, t_ns: int) -> Events:
        """The pending events up to the first one later than t_ns, which stays for the next call.

        Triggers are cut alike. Afterwards `at_cut` tells whether something later was met (`next_t_ns` is its time) or
        more bytes are needed. A sensor's times may step back by some us, so an event <= t_ns may still follow the cut:
        the order is kept.
        """
        return self._decode(t_ns // 1000)

    def _decode(self, limit_us: int) -> Events:
        begin = self._at * self.word.itemsize
        parts = []
        if self.backend == "numpy":
            events, used, next_us = self.decode_words(self._words[self._at :], limit_us)
            self._at += used
            parts.append(events)
        else:
            next_us = -1
            while self._at < len(self._words) and next_us < 0:
                events, next_us = self._launch(limit_us)
                parts.append(events)
        self.next_t_ns = next_us * 1000 if self.at_cut else None
        self._taken = (begin, self._at * self.word.itemsize)
        return Events.concatenate(parts) if parts else Events.empty()

    @abc.abstractmethod
    def decode_words(self, words: np.ndarray, limit_us: int) -> tuple[Events, int, int]:
        """Reference in numpy: events, words used, and the time [us] of the event at the cut or -1. Updates `state`."""

    def _launch(self, limit_us: int) -> tuple[Events, int]:
        if self._launcher is None:
            self._launcher = WarpLauncher(self.encoding)
        if self._fresh:
            self._launcher.load(self._words)
            self._fresh = False
        events, self._at, next_us = self._launcher.run(self._at, limit_us, self.width, self.height, self.state)
        return events, next_us


class WarpLauncher:
    """Runs one codec's kernel over a buffer, at most `_SCRATCH` events at a time."""

    def __init__(self, encoding: str) -> None:
        from evis.streams import kernels

        self._kernels, self._kernel = kernels, kernels.DECODE[encoding]
        self._out = np.zeros(4, np.int64)
        self._scratch = [np.empty(_SCRATCH, d) for d in (np.int64, np.uint16, np.uint16, np.uint8)]
        self._edges = [np.empty(_TRIGGERS, d) for d in (np.int64, np.uint8, np.uint8)]
        self._outputs = [kernels.view(a) for a in (self._out, *self._scratch, *self._edges)]
        self._words: np.ndarray | None = None

    def load(self, words: np.ndarray) -> None:
        """The buffer that the next runs read; kept alive here. Unaligned buffers are copied."""
        self._words = np.require(words, requirements=["A"])
        self._input = self._kernels.view(self._words)

    def run(self, at: int, limit_us: int, width: int, height: int, state: np.ndarray) -> tuple[Events, int, int]:
        """Decode from word `at`: events, the word to go on with, and the time [us] of the event at the cut or -1."""
        self._kernels.launch(self._kernel, [self._input, at, limit_us, width, height], [state, *self._outputs])
        at, n, m, next_us = (int(v) for v in self._out)
        t, x, y, p = (a[:n].copy() for a in self._scratch)
        triggers = Triggers(*(a[:m].copy() for a in self._edges)) if m else Triggers()
        return Events(t, x, y, p, triggers=triggers), at, next_us
