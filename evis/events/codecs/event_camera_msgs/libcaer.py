"""Decodes and encodes the `libcaer` payload of event_camera_msgs: polarity events of AEDAT 3.1, 8 bytes each.

Bit 0 valid, bit 1 polarity, bits 2-16 y, bits 17-31 x, then int32 us. Times are the message's base plus these; where
they fall by half their range or more, they have turned (+2^31 us).
"""

from __future__ import annotations

import numpy as np

from evis.events.arrays import Events
from evis.events.codecs.event_camera_msgs import payload as ecm

_TURNS, _LAST, _INVALID = 4, 5, 6
TURN_US = 1 << 31


class Decoder(ecm.RecordDecoder):
    """Decodes `libcaer` messages to events. Events that the driver has marked as invalid are dropped and counted."""

    encoding = "libcaer"
    wrap_ns = TURN_US * 1000
    state_size = 7
    counters = {**ecm.Decoder.counters, "invalid": _INVALID}

    def _reset_context(self) -> None:
        self.state[[_TURNS, _LAST]] = 0

    def decode_words(self, words: np.ndarray, limit: int) -> tuple[Events, int, int]:
        """Decodes records, and keeps the turns of the time counter up to the cut."""
        events, cut, following = super().decode_words(words, limit)
        if cut:
            turns, low = self._count(words[:cut])
            self.state[_TURNS], self.state[_LAST] = turns[-1], low[-1]
        return events, cut, following

    def _count(self, words: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        low = (words >> np.uint64(32)).astype(np.int64) & TURN_US - 1
        before = np.append(self.state[_LAST], low[:-1])[: len(low)]
        return self.state[_TURNS] + np.cumsum(before >= low + TURN_US // 2), low

    def _times(self, words: np.ndarray) -> np.ndarray:
        turns, low = self._count(words)
        return self.state[ecm.BASE] + (turns * TURN_US + low) * 1000

    def _records(self, words: np.ndarray, t: np.ndarray) -> Events:
        head = words.astype(np.uint32)
        valid = head & 1 == 1
        if not valid.all():
            self.state[_INVALID] += np.count_nonzero(~valid)
            head, t = head[valid], t[valid]
        x, y = (head >> 17).astype(np.uint16), (head >> 2 & 0x7FFF).astype(np.uint16)
        p = (head >> 1 & 1).astype(np.uint8)
        return self._inside(Events(t, x, y, p))


class Encoder(ecm.Encoder):
    """Encodes events as `libcaer` messages; times are rounded down to whole us."""

    encoding = "libcaer"
    word = np.dtype("<u8")
    columns, rows, channels = 1 << 15, 1 << 15, 0
    span_ns = (TURN_US // 2) * 1000
    base_ns = 1000

    def _message(self, events: Events, base_ns: int) -> bytes:
        us = (self._fit(events.t, base_ns) // 1000).astype(self.word)
        x, y, p = (events.x.astype(self.word), events.y.astype(self.word), events.p.astype(self.word))
        return (
            us << np.uint64(32) | x << np.uint64(17) | y << np.uint64(2) | p << np.uint64(1) | np.uint64(1)
        ).tobytes()
