"""Implements what the encoders share, and the time words of the Prophesee ones."""

from __future__ import annotations

import abc
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from evis.events.arrays import Events
from evis.events.codecs.decoder import codec_of

REBASE = "use --rebase, which subtracts the first time, or write .npz"
"""Remedy where a format counts from 0 and times begin below it or too far behind."""
MAX_TURNS = 10_000
"""Turns of the counter that an encoder writes to reach a time; more means that the times do not count from 0."""


@dataclass(slots=True)
class MergedStream:
    """Holds events and triggers in stream order, all int64 [n]; for a trigger x is the channel and p the value."""

    t_us: np.ndarray
    x: np.ndarray
    y: np.ndarray
    p: np.ndarray
    is_trigger: np.ndarray


def merge(events: Events) -> MergedStream:
    """Merges triggers into the events, each before the first event that is later; the order of either kind is kept."""
    n, edges = len(events), events.triggers
    columns = [c.astype(np.int64) for c in (events.t // 1000, events.x, events.y, events.p)]
    if not len(edges):
        return MergedStream(columns[0], columns[1], columns[2], columns[3], np.zeros(n, bool))
    place = np.searchsorted(np.maximum.accumulate(events.t), edges.t, "right") if n else np.zeros(len(edges), np.int64)
    place = np.maximum.accumulate(place)
    added = [edges.t // 1000, edges.id, np.zeros(len(edges), np.int64), edges.value]
    t_us, x, y, p = (np.insert(c, place, e) for c, e in zip(columns, added))
    return MergedStream(t_us, x, y, p, np.insert(np.zeros(n, bool), place, True))


def scatter(out: np.ndarray, at: np.ndarray, where: np.ndarray, words: np.ndarray) -> np.ndarray:
    """Writes words[i] at out[at[i]] where `where` holds, and returns the places behind them."""
    out[at[where]] = words[where]
    return at + where


def reserve_words(
    lengths: np.ndarray, steps: dict[int, np.ndarray], dtype: Any = np.int64
) -> tuple[np.ndarray, np.ndarray]:
    """Makes an array with room for items of the given lengths and, before some of them, the words of `steps`, which it
    writes.

    Returns the words, 0 where the items are to be written, and int64 [n], the place of each item in them.
    """
    extra = np.zeros(len(lengths), np.int64)
    extra[list(steps)] = [len(words) for words in steps.values()]
    end = np.cumsum(extra + lengths)
    at = end - lengths
    out = np.zeros(int(end[-1]), dtype)
    for i, words in steps.items():
        out[at[i] - len(words) : at[i]] = words
    return out, at


def find_groups(t_us: np.ndarray, events: Events) -> tuple[np.ndarray, np.ndarray]:
    """Finds the runs of events that one mask of eight rows can hold in their order: first events, and masks."""
    x, y, p = events.x, events.y.astype(np.int64), events.p
    joins = np.zeros(len(x), bool)
    joins[1:] = (t_us[1:] == t_us[:-1]) & (x[1:] == x[:-1]) & (p[1:] == p[:-1])
    joins[1:] &= (y[1:] >> 3 == y[:-1] >> 3) & (y[1:] > y[:-1])
    heads = np.flatnonzero(~joins)
    return heads, np.add.reduceat(1 << (y & 7), heads) if len(heads) else np.empty(0, np.int64)


def encoder_for(encoding: str, width: int = 0, height: int = 0, resync: bool = False) -> Encoder:
    """Makes the encoder of an encoding. Raises ValueError that lists the known ones.

    width, height: the sensor, where the words depend on it (0 = the device's own).
    """
    codec = codec_of(encoding).Encoder(resync)
    codec.width, codec.height = width or codec.width, height or codec.height
    return codec


class Encoder(abc.ABC):
    """Encodes events as wire words, with state carried from call to call. Times are rounded down to the wire's unit.

    resync: every call starts with time and address words, so that its bytes decode alone (up to turns of the counter).
    """

    encoding: ClassVar[str]
    word: ClassVar[np.dtype[Any]]
    columns: ClassVar[int]
    rows: ClassVar[int]
    channels: ClassVar[int]
    """Addresses and trigger channels that the words can hold; 0 channels: no triggers."""
    width, height = 0, 0
    """The sensor, for words that depend on it."""

    def __init__(self, resync: bool = False) -> None:
        self.resync = resync

    @abc.abstractmethod
    def encode(self, events: Events) -> bytes:
        """Encodes events and triggers.

        Raises ValueError for what the words cannot hold: colour, addresses outside the range, frames and inertial
        samples that the device has not, times that are negative, that start far beyond 0 or step back too far.
        """

    def advance(self, t_ns: int) -> bytes:
        """Encodes time words alone up to t_ns, as a sensor without events sends them; empty where the wire has none."""
        return b""

    def encode_packets(self, events: Events) -> list[tuple[int, bytes]]:
        """Encodes payloads of event_camera_msgs/EventPacket: (time_base_ns, bytes) of each."""
        return [(int(events.t[0]) if len(events) else 0, self.encode(events))]

    def _check(self, events: Events) -> None:
        if events.c is not None:
            raise ValueError(f"{self.encoding} has no colour channel; write .npz")
        for name, values, limit in (("x", events.x, self.columns), ("y", events.y, self.rows)):
            if len(values) and int(values.max()) >= limit:
                raise ValueError(f"{self.encoding} holds {name} up to {limit - 1}, not {values.max()}")
        if len(events.triggers) and not self.channels:
            raise ValueError(f"{self.encoding} has no triggers")
        if len(events.triggers) and int(events.triggers.id.max()) >= self.channels:
            raise ValueError(f"{self.encoding} holds trigger channels up to {self.channels - 1}")
        self._check_samples(events)
        for t in (events.t, events.triggers.t):
            if len(t) and int(t.min()) < 0:
                raise ValueError(f"{self.encoding} cannot hold the negative time {t.min()} ns; {REBASE}")

    def _check_samples(self, events: Events) -> None:
        if len(events.imu) or events.frames:
            raise ValueError(f"{self.encoding} holds events and triggers alone, no inertial samples or frames")


class PropheseeEncoder(Encoder):
    """Encodes events as words whose time consists of a TIME_HIGH word and a low part."""

    high_bits: ClassVar[int]
    low_bits: ClassVar[int]

    def __init__(self, resync: bool = False) -> None:
        super().__init__(resync)
        self._high: int | None = None
        self._low = -1
        self._row = -1

    def encode(self, events: Events) -> bytes:
        """Encodes events and triggers; see `Encoder.encode`."""
        self._check(events)
        if not len(events) and not len(events.triggers):
            return b""
        if self.resync:
            self._low = self._row = -1
        item = merge(events)
        high = item.t_us >> self.low_bits
        before = np.concatenate([[-1 if self._high is None else self._high], high[:-1]])
        new_high = high != before
        if self.resync:
            new_high[0] = True
        steps = {int(i): self._turn_words(int(before[i]), int(high[i])) for i in self._turn_places(before, high)}
        words = self._write(item, new_high, {i: w for i, w in steps.items() if len(w)})
        self._high = int(high[-1])
        return self._pack(words)

    def _pack(self, words: np.ndarray) -> bytes:
        return words.astype(self.word).tobytes()

    def _turn_places(self, before: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Finds the items before which one TIME_HIGH word is not enough: a turn of the counter passes, or time steps
        back."""
        return np.flatnonzero((before >> self.high_bits != high >> self.high_bits) | (high < before))

    def _turn_words(self, before: int, high: int) -> np.ndarray:
        """Makes the TIME_HIGH words between two times: of each turn of the counter its last value and its first.

        A sensor sends every value. Other readers than EVIS and openeb's EVT3 see a turn only where TIME_HIGH falls by
        nearly all of its range: by all but 10 in openeb's EVT2 and the decoders of Metavision's samples.
        """
        last = (1 << self.high_bits) - 1
        if high < before:
            if before - high > last >> 1 or before >> self.high_bits != high >> self.high_bits:
                raise ValueError(
                    f"{self.encoding} cannot hold times that step back by {(before - high) * self._unit_s:.3g} s "
                    "(half a turn of its counter, or over a turn); sort the events by time or write .npz"
                )
            return np.empty(0, self.word)
        # nothing was sent yet: the first TIME_HIGH is taken as it is, turns are counted from there
        turns = (high >> self.high_bits) - (max(before, 0) >> self.high_bits)
        if turns > MAX_TURNS:
            raise ValueError(
                f"{self.encoding} counts from 0 in turns of {self.turn_s:.4g} s; a jump to {high * self._unit_s:.6g} s "
                f"is too far; {REBASE}"
            )
        values = np.tile(np.array([last, 0], np.int64), turns)
        return self.time_high_words(values[before & last == last and before >= 0 : len(values) - (high & last == 0)])

    @property
    def turn_s(self) -> float:
        """Returns the period of the counter on the wire [s]."""
        return (1 << self.high_bits + self.low_bits) / 1e6

    @property
    def _unit_s(self) -> float:
        return (1 << self.low_bits) / 1e6

    def advance(self, t_ns: int) -> bytes:
        """Encodes the TIME_HIGH words up to t_ns, as a sensor without events sends them."""
        high = t_ns // 1000 >> self.low_bits
        before = -1 if self._high is None else self._high
        if high <= before:
            return b""
        steps = self._turn_words(before, high)
        self._high, self._low = high, 0
        return self._pack(np.append(steps, self.time_high_words(np.array([high]))))

    @abc.abstractmethod
    def time_high_words(self, high: np.ndarray) -> np.ndarray:
        """Makes TIME_HIGH words of counts of high units."""

    @abc.abstractmethod
    def _write(self, item: MergedStream, new_high: np.ndarray, steps: dict[int, np.ndarray]) -> np.ndarray:
        """Writes all words; `steps` stand before an item's own TIME_HIGH."""
