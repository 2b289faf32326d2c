"""Implements payloads of event_camera_msgs/EventPacket: every message stands alone and has a time base.

`evt3` payloads are the camera's words and go on from message to message: see `evt3`.
"""

from __future__ import annotations

import abc

import numpy as np

from evis.events.arrays import Events
from evis.events.codecs import decoder
from evis.events.codecs.encoder import Encoder as _Encoder

MAX_BASE_NS = 1 << 62
"""Time bases from here on (the year 2116) are taken for damage: sums would leave int64."""

BASE, CUT, OUTSIDE = 1, 2, 3
"""Places in every state: time base [ns], words that messages ended within, events outside."""


class Decoder(decoder.Decoder):
    """Implements what the decoders of whole messages share. `decode` alone takes bytes of a message with base 0."""

    counters = {"outside": OUTSIDE, "cut_words": CUT}

    def feed_packet(self, data: bytes | bytearray | memoryview | np.ndarray, time_base_ns: int = 0) -> None:
        """Begins a message. Raises ValueError when the one before has words left, or for an impossible base."""
        if self.at_cut:
            raise ValueError(f"{self.encoding}: decode the rest of a message before feeding the next one")
        if not 0 <= time_base_ns < MAX_BASE_NS:
            raise ValueError(f"{self.encoding}: a message has the impossible time base {time_base_ns} ns")
        self.state[CUT] += bool(self.pending)
        self._drop_pending()
        self._reset_context()
        self.state[BASE] = time_base_ns
        self.feed(data)

    def _inside(self, events: Events) -> Events:
        """Selects the events inside the sensor, and counts the others."""
        if not self.width and not self.height:
            return events
        t, x, y, p = events.t, events.x, events.y, events.p
        keep = (x < (self.width or 1 << 16)) & (y < (self.height or 1 << 16))
        if keep.all():
            return events
        self.state[OUTSIDE] += np.count_nonzero(~keep)
        return Events(t[keep], x[keep], y[keep], p[keep])


class RecordDecoder(Decoder):
    """Decodes records of fixed size, by numpy alone: their times do not depend on the records before."""

    word = np.dtype("<u8")
    tick_ns = 1
    wrap_ns = 1 << 32
    state_size = 4

    def decode_words(self, words: np.ndarray, limit: int) -> tuple[Events, int, int]:
        """Decodes records up to the first one later than `limit` [ns]."""
        t = self._times(words)
        late = t > limit
        following, cut = -1, len(words)
        if late.any():
            cut = int(np.argmax(late))
            following = int(t[cut])
        return self._records(words[:cut], t[:cut]), cut, following

    @abc.abstractmethod
    def _times(self, words: np.ndarray) -> np.ndarray:
        """Computes the time of each record, int64 [ns]."""

    @abc.abstractmethod
    def _records(self, words: np.ndarray, t: np.ndarray) -> Events:
        """Converts records to events or triggers. Updates `state`."""


class Encoder(_Encoder):
    """Encodes whole messages: `encode` one with base 0, `encode_packets` as many as are needed."""

    span_ns: int
    """Times of one message lie within this many ns of its base."""
    base_ns = 1
    """Bases are multiples of this."""

    def encode(self, events: Events) -> bytes:
        """Encodes the payload of one message whose time base is 0. Raises ValueError where the times do not fit."""
        self._check(events)
        return self._message(events, 0)

    def encode_packets(self, events: Events) -> list[tuple[int, bytes]]:
        """Encodes messages as (time_base_ns, bytes), each as long as its times allow."""
        self._check(events)
        t = self._sequence(events)
        packets: list[tuple[int, bytes]] = []
        first = 0
        while first < len(t) or not packets:
            low, high = np.minimum.accumulate(t[first:]), np.maximum.accumulate(t[first:])
            base = low // self.base_ns * self.base_ns
            # the spread only ever grows
            end = first + int(np.searchsorted(high - base, self.span_ns))
            start = int(base[end - first - 1]) if len(t) else 0
            packets.append((start, self._message(self._part(events, slice(first, end)), start)))
            first = end
        return packets

    def _sequence(self, events: Events) -> np.ndarray:
        return events.t

    def _part(self, events: Events, part: slice) -> Events:
        return events[part]

    def _fit(self, t: np.ndarray, base_ns: int) -> np.ndarray:
        """Computes times since the base. Raises ValueError where they do not fit."""
        since = t - np.int64(base_ns)
        if len(since) and not (since.min() >= 0 and since.max() < self.span_ns):
            raise ValueError(
                f"{self.encoding} holds times up to {self.span_ns / 1e9:.4g} s after a base; use encode_packets"
            )
        return since

    @abc.abstractmethod
    def _message(self, events: Events, base_ns: int) -> bytes:
        """Encodes one payload."""
