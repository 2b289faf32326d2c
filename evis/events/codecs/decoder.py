"""Implements what all stream decoders share: input in pieces of any size, state carried between them, exact cuts in
time."""

from __future__ import annotations

import abc
import importlib
from typing import Any, ClassVar

import numpy as np

from evis.events.arrays import Events
from evis.events.codecs.buffer import EventBuffer
from evis.events.codecs.launcher import WarpLauncher

FOREVER = 2**62
"""A limit (in ticks of any codec) later than every time stamp."""
_SCRATCH = 1 << 19
"""Events that one launch gives where its caller has no place for them: 6.8 MB of scratch."""
_LARGE = 1 << 16
"""Words from which on the events of a launch are not copied out of scratch: their arrays then keep what was set aside
for them, of which the system gives only the pages that were written."""
_BLOCK = 1 << 16
"""Words that numpy decodes at a time: what it makes of them stays in the cache."""
NUMPY_BYTES = 16 << 20
"""Size below which numpy (5-10 Mev/s) is done before Warp would have been imported (about 1 s)."""

CODECS = {
    "evt2": "evis.events.codecs.prophesee.evt2",
    "evt21": "evis.events.codecs.prophesee.evt21",
    "evt21_legacy": "evis.events.codecs.prophesee.evt21_legacy",
    "evt3": "evis.events.codecs.prophesee.evt3",
    "evt4": "evis.events.codecs.prophesee.evt4",
    "davis346": "evis.events.codecs.inivation.davis",
    "dvxplorer": "evis.events.codecs.inivation.dvxplorer",
    "dvxplorer_mini": "evis.events.codecs.inivation.dvxplorer_mini",
    "dvs128": "evis.events.codecs.inivation.dvs128",
    "libcaer": "evis.events.codecs.event_camera_msgs.libcaer",
    "libcaer_cmp": "evis.events.codecs.event_camera_msgs.libcaer_cmp",
    "mono": "evis.events.codecs.event_camera_msgs.mono_codec",
    "trigger": "evis.events.codecs.event_camera_msgs.trigger",
}
"""Encodings and their modules, each with a `Decoder` and an `Encoder`: words of cameras, and the payloads of
event_camera_msgs (`evt3` is both)."""


def backend_for(size: int) -> str:
    """Returns the faster backend for an amount of data [bytes], `numpy` or `warp`; both give the same bits."""
    return "numpy" if size <= NUMPY_BYTES else "warp"


def decoder_for(encoding: str, width: int = 0, height: int = 0, backend: str = "numpy") -> Decoder:
    """Makes the decoder of an encoding. Raises ValueError that lists the known ones."""
    return codec_of(encoding).Decoder(width, height, backend)


def codec_of(encoding: str) -> Any:
    """Imports the module of an encoding. Raises ValueError that lists the known ones."""
    if encoding not in CODECS:
        raise ValueError(f"the event encoding '{encoding}' is not supported; supported are {', '.join(sorted(CODECS))}")
    return importlib.import_module(CODECS[encoding])


def count_until(which: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Counts the words of a kind up to each word `at`. which: bool, for all words.

    Two to four times as fast as searchsorted for words that come in blocks.
    """
    return np.cumsum(which, dtype=np.int32)[at]


class Decoder(abc.ABC):
    """Decodes the words of one sensor to events. Bytes may be fed in any pieces, cut also inside a word.

    width, height: events outside are dropped and counted; 0 = the device's own (`geometry`), or where the encoding has
    none, unknown: then nothing is dropped. backend: `numpy` or `warp` (a sequential CPU kernel); results and state are
    bit-equal. Times are the device's: ns since its last timestamp reset, turns of the counter counted from 0.
    """

    encoding: ClassVar[str]
    word: ClassVar[np.dtype[Any]]
    wrap_ns: ClassVar[int]
    """The counter on the wire starts again after this time [ns]; the decoder counts the turns."""
    tick_ns: ClassVar[int] = 1000
    """Unit of the limits and times of `decode_words`."""
    state_size: ClassVar[int]
    counters: ClassVar[dict[str, int]]
    """What is dropped or odd -> its place in `state`."""
    geometry: ClassVar[tuple[int, int]] = (0, 0)
    kernel: ClassVar[str] = ""
    """`module:function` of the Warp kernel; empty where records of fixed size are read with numpy alone."""
    has_side: ClassVar[bool] = False
    """The kernel also gives the words of other parts of the sensor, each with its time, for `_assemble`."""
    transposed: bool = False
    """The device reads out its pixels' columns as rows: what its words call x and y is y and x of the image."""

    def __init__(self, width: int = 0, height: int = 0, backend: str = "numpy") -> None:
        if backend not in ("numpy", "warp"):
            raise ValueError(f"decoder backend is '{backend}', must be numpy or warp")
        self.width, self.height = width or self.geometry[0], height or self.geometry[1]
        self.backend = backend if self.kernel else "numpy"
        self._launcher: WarpLauncher | None = None
        self._scratch: EventBuffer | None = None
        self.reset()

    def reset(self) -> None:
        """Resets the decoder to its initial state, with the turns of the counter and `counts` at 0."""
        self.state = np.zeros(self.state_size, np.int64)
        self._reset_context()
        self._drop_pending()

    def prepare(self) -> None:
        """Compiles and loads the kernel now (up to seconds), which otherwise happens with the first bytes."""
        if self.backend == "warp" and self._launcher is None:
            self._launcher = WarpLauncher(self.kernel, self.has_side)
            self._launcher.load(np.zeros(1, self._words.dtype))
            self._launcher.run(1, FOREVER, self.readout, self.transposed, self.state.copy(), EventBuffer(0))

    def resync(self) -> None:
        """Continues after a loss of bytes: drops what is half read, and all words up to the next one with a time.

        The turns of the counter are kept, so that times go on; turns inside the gap are missed. `counts` goes on.
        """
        self.state[0] = -1 if self.state[0] else 0
        self._reset_context()
        self._drop_pending()

    def _reset_context(self) -> None:  # noqa: B027 (most codecs keep nothing)
        """Resets what a codec keeps besides `state`, and addresses in `state`, which after a gap belong to nothing."""

    def _drop_pending(self) -> None:
        self._bytes: bytes | bytearray | memoryview = b""
        self._words = np.empty(0, self.word)
        self._at = 0
        self._fresh = True
        self._taken: tuple[int, int] = (0, 0)
        self.next_t_ns: int | None = None

    # -- counters ----------------------------------------------------------------------------------------------------

    @property
    def outside(self) -> int:
        """Returns the number of events dropped because they lie outside width x height."""
        return int(self.state[self.counters["outside"]])

    @property
    def untimed(self) -> int:
        """Returns the number of words dropped because no time had been sent yet."""
        return int(self.state[self.counters["untimed"]]) if "untimed" in self.counters else 0

    @property
    def counts(self) -> dict[str, int]:
        """Returns what was dropped or unusual so far, by kind (`outside`, `untimed`, `unknown`, ...); only counts above
        0."""
        return {kind: int(self.state[place]) for kind, place in self.counters.items() if self.state[place]}

    @property
    def readout(self) -> tuple[int, int]:
        """Returns the columns and rows as the device's words count them, exchanged where it is transposed."""
        return (self.height, self.width) if self.transposed else (self.width, self.height)

    @property
    def pending(self) -> int:
        """Returns the number of bytes fed and not yet decoded: whole words after a cut, or the first part of a word."""
        return len(self._bytes) - self._at * self.word.itemsize

    @property
    def at_cut(self) -> bool:
        """Tells whether the last `decode_until` stopped at its limit; False when it needs more bytes."""
        return self._at < len(self._words)

    @property
    def taken(self) -> np.ndarray:
        """Returns the wire bytes (uint8, a view) that the last call decoded; those of a word begun before come with its
        end."""
        return np.frombuffer(self._bytes, np.uint8)[self._taken[0] : self._taken[1]]

    # -- decoding ----------------------------------------------------------------------------------------------------

    def feed(self, data: bytes | bytearray | memoryview | np.ndarray) -> None:
        """Adds bytes behind those that are pending. The buffer must not change until it is decoded."""
        if isinstance(data, np.ndarray):
            data = np.ascontiguousarray(data).data.cast("B")
        left = self.pending
        if left:
            data = bytes(memoryview(self._bytes)[len(self._bytes) - left :]) + bytes(data)
        self._bytes, self._at, self._fresh = data, 0, True
        self._words = self._view(np.frombuffer(data, self.word, len(data) // self.word.itemsize))

    def _view(self, words: np.ndarray) -> np.ndarray:
        """Returns the words in the form that the kernel reads."""
        return words

    def decode(self, data: bytes | bytearray | memoryview | np.ndarray = b"") -> Events:
        """Decodes all events of the pending bytes and of `data`."""
        if len(data):
            self.feed(data)
        return self._decode(FOREVER)

    def decode_until(self, t_ns: int) -> Events:
        """Decodes the pending events up to the first one later than t_ns, which stays for the next call.

        Triggers and other samples are cut alike. Afterwards `at_cut` tells whether something later was met
        (`next_t_ns` is its time) or more bytes are needed. A sensor's times may step back by some us, so an event
        <= t_ns may still follow the cut: the order is kept.
        """
        return self._decode(t_ns // self.tick_ns)

    def decode_into(self, buffer: EventBuffer, t_ns: int | None = None) -> list[Events]:
        """Decodes as `decode_until` does (None: all that is pending), and appends to `buffer`, which grows as needed.

        Returns what else came (triggers, inertial samples, frames), in parts without events; mostly none.
        """
        limit = FOREVER if t_ns is None else t_ns // self.tick_ns
        begin = self._at * self.word.itemsize
        others: list[Events] = []
        following = -1
        while self._at < len(self._words) and following < 0:
            before = self._at
            if self.backend == "numpy":
                part, self._at, following = self._decode_block(limit)
                buffer.append(part)
                other: Events | None = part.without_events()
            else:
                other, following = self._launch(limit, buffer)
                if self._at == before and following < 0:
                    buffer.grow()
            if other is not None and other.has_aside:
                others.append(other)
        self._end_call(begin, following)
        return others

    def feed_packet(self, data: bytes | bytearray | memoryview | np.ndarray, time_base_ns: int = 0) -> None:
        """Adds the payload of one event_camera_msgs/EventPacket. Words of cameras continue the stream; the base is not
        used."""
        self.feed(data)

    def decode_packet(self, data: bytes | bytearray | memoryview | np.ndarray, time_base_ns: int = 0) -> Events:
        """Decodes all events of one event_camera_msgs/EventPacket."""
        self.feed_packet(data, time_base_ns)
        return self.decode()

    def _decode(self, limit: int) -> Events:
        begin = self._at * self.word.itemsize
        parts, following = [], -1
        while self._at < len(self._words) and following < 0:
            if self.backend == "numpy":
                part, self._at, following = self._decode_block(limit)
            else:
                part, following = self._launch_apart(limit)
            parts.append(part)
        self._end_call(begin, following)
        return Events.concatenate(parts) if parts else Events.empty()

    def _end_call(self, begin: int, following: int) -> None:
        """Notes where a call stopped, which had begun at byte `begin`."""
        self.next_t_ns = following * self.tick_ns if self.at_cut else None
        self._taken = (begin, self._at * self.word.itemsize)

    def _decode_block(self, limit: int) -> tuple[Events, int, int]:
        """Decodes one block by numpy; returns events, the word to continue with, and the time at the cut or -1."""
        events, used, following = self.decode_words(self._words[self._at : self._at + _BLOCK], limit)
        if self.transposed:
            events.x, events.y = events.y, events.x
        return events, self._at + used, following

    @abc.abstractmethod
    def decode_words(self, words: np.ndarray, limit: int) -> tuple[Events, int, int]:
        """Decodes words by numpy; returns events, number of words used, and the time [ticks] of the event at the cut or
        -1.

        Updates `state`.
        """

    def _assemble(self, events: Events, t: np.ndarray, words: np.ndarray) -> None:  # noqa: B027 (has_side only)
        """Puts what the side words (t int64 [us], words) complete into `events`."""

    def _launch_apart(self, limit: int) -> tuple[Events, int]:
        """Launches the kernel, and returns its events in memory of their own."""
        words = len(self._words) - self._at
        if words >= _LARGE and limit == FOREVER:
            buffer = EventBuffer(max(words, _SCRATCH))
            other, following = self._launch(limit, buffer)
            events = buffer.events()
        else:
            if self._scratch is None:
                self._scratch = EventBuffer(_SCRATCH)
            self._scratch.n = 0
            other, following = self._launch(limit, self._scratch)
            part = self._scratch.events()
            events = Events(part.t.copy(), part.x.copy(), part.y.copy(), part.p.copy())
        return (events if other is None else events.beside(other)), following

    def _launch(self, limit: int, buffer: EventBuffer) -> tuple[Events | None, int]:
        """Launches the kernel, which appends to `buffer`; returns what came besides events, and the time at the cut or
        -1."""
        if self._launcher is None:
            self._launcher = WarpLauncher(self.kernel, self.has_side)
        if self._fresh:
            self._launcher.load(self._words)
            self._fresh = False
        triggers, side, self._at, following = self._launcher.run(
            self._at, limit, self.readout, self.transposed, self.state, buffer
        )
        if triggers is None and side is None:
            return None, following
        other = Events.empty()
        if triggers is not None:
            other.triggers = triggers
        if side is not None:
            self._assemble(other, *side)
        return other, following
