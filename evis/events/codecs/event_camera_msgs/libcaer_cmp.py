"""Decodes and encodes the `libcaer_cmp` payload of event_camera_msgs: 16-bit words, a code in bits 12-15.

0 TIME_HIGH and 1 TIME_LOW: 12 bits each, us since the message's base; 2 ADDR_X: x of what follows; 3 ADDR_Y: y and
polarity (bit 11) of one event; 4 VECT_BASE_Y: y and polarity of vectors; 5 VECT_8: a mask of eight rows from there on,
after which the base moves by 8. Nothing is carried over from message to message.
"""

from __future__ import annotations

import numpy as np

from evis.events.arrays import Events
from evis.events.codecs.encoder import find_groups
from evis.events.codecs.event_camera_msgs import payload as ecm

TIME_HIGH, TIME_LOW, ADDR_X, ADDR_Y, BASE_Y, VECT_8 = range(6)
HIGH, LOW, COLUMN, ROW, SIGN, UNKNOWN = range(4, 10)
"""Places in the state vector, behind those of `payload`."""
CODE_SHIFT, DATA_MASK, HIGH_SHIFT, ADDRESS_MASK, SIGN_SHIFT, ROWS = 12, 0xFFF, 12, 0x7FF, 11, 8


class Decoder(ecm.Decoder):
    """Decodes `libcaer_cmp` messages to events. The base counts in whole us, as times do."""

    encoding = "libcaer_cmp"
    word = np.dtype("<u2")
    wrap_ns = 1000 << 24
    state_size = 10
    counters = {**ecm.Decoder.counters, "unknown": UNKNOWN}
    kernel = "evis.events.codecs.event_camera_msgs.libcaer_cmp_kernels:decode_libcaer_cmp"

    def _reset_context(self) -> None:
        self.state[[HIGH, LOW, COLUMN, ROW, SIGN]] = 0

    def decode_words(self, words: np.ndarray, limit: int) -> tuple[Events, int, int]:
        """Decodes words by numpy, the twin of the kernel."""
        state, kind = self.state, words >> CODE_SHIFT
        data = words.astype(np.int64) & DATA_MASK
        at = {code: np.flatnonzero(kind == code) for code in (TIME_HIGH, TIME_LOW, ADDR_X, BASE_Y)}
        events = np.flatnonzero((kind == ADDR_Y) | (kind == VECT_8))
        high = np.append(state[HIGH], data[at[TIME_HIGH]])
        low = np.append(state[LOW], data[at[TIME_LOW]])
        since = (high[np.searchsorted(at[TIME_HIGH], events)] << HIGH_SHIFT) + low[
            np.searchsorted(at[TIME_LOW], events)
        ]
        times = state[ecm.BASE] // 1000 + since
        late = times > limit
        following, cut = -1, len(words)
        if late.any():
            i = int(np.argmax(late))
            following, cut = int(times[i]), int(events[i])
            kind, data, events, times = kind[:cut], data[:cut], events[:i], times[:i]
            at = {code: place[place < cut] for code, place in at.items()}
        state[HIGH], state[LOW] = high[len(at[TIME_HIGH])], low[len(at[TIME_LOW])]
        state[UNKNOWN] += np.count_nonzero(kind > VECT_8)
        return self._expand(kind, data, at, events, times), cut, following

    def _expand(
        self, kind: np.ndarray, data: np.ndarray, at: dict[int, np.ndarray], events: np.ndarray, times: np.ndarray
    ) -> Events:
        state = self.state
        columns = np.append(state[COLUMN], data[at[ADDR_X]] & ADDRESS_MASK)
        bases = np.append(state[ROW], data[at[BASE_Y]] & ADDRESS_MASK)
        signs = np.append(state[SIGN], data[at[BASE_Y]] >> SIGN_SHIFT)
        # rows that all vectors have moved the base by before each word
        moved = np.append(0, np.cumsum(np.where(kind == VECT_8, ROWS, 0)))
        moved_at_base = np.append(0, moved[at[BASE_Y]])
        state[COLUMN], state[SIGN] = columns[-1], signs[-1]
        state[ROW] = (bases[-1] + moved[-1] - moved_at_base[-1]) & 0xFFFF
        single = kind[events] == ADDR_Y
        base = np.searchsorted(at[BASE_Y], events)
        row = np.where(single, data[events] & ADDRESS_MASK, bases[base] + moved[events] - moved_at_base[base])
        sign = np.where(single, data[events] >> SIGN_SHIFT, signs[base])
        mask = np.where(single, 1, data[events] & 0xFF).astype(np.uint8)
        flat = np.flatnonzero(np.unpackbits(mask, bitorder="little").view(bool))
        of = flat >> 3
        x = columns[np.searchsorted(at[ADDR_X], events)][of].astype(np.uint16)
        y = ((row[of] + (flat & 7)) & 0xFFFF).astype(np.uint16)
        t, p = times[of] * 1000, sign[of].astype(np.uint8)
        return self._inside(Events(t, x, y, p))


class Encoder(ecm.Encoder):
    """Encodes events as `libcaer_cmp` messages: rows of eight share masks (one time, column, polarity, rising)."""

    encoding = "libcaer_cmp"
    word = np.dtype("<u2")
    columns, rows, channels = 2048, 2048, 0
    span_ns = 1000 << 24
    base_ns = 1000

    def _message(self, events: Events, base_ns: int) -> bytes:
        us = self._fit(events.t, base_ns) // 1000
        n = len(us)
        if not n:
            return b""
        heads, mask = find_groups(us, events)
        size = np.diff(np.append(heads, n))
        x, y, p = (a.astype(np.int64) for a in (events.x, events.y, events.p))
        us, x, y, p = us[heads], x[heads], y[heads], p[heads]
        many = size > 2
        words = np.stack(
            [us >> 12, 1 << 12 | us & 0xFFF, 2 << 12 | x, 4 << 12 | p << 11 | y & ~7, 5 << 12 | mask], axis=1
        )
        words[~many, 3] = 3 << 12 | p[~many] << 11 | y[~many]
        # a pair is two single events: the second in place of the mask
        pair = size == 2
        words[pair, 4] = 3 << 12 | p[pair] << 11 | events.y[heads + size - 1].astype(np.int64)[pair]
        used = np.stack(
            [np.diff(us >> 12, prepend=0) != 0, np.diff(us, prepend=0) != 0, np.diff(x, prepend=0) != 0], axis=1
        )
        used = np.concatenate([used, np.ones((len(us), 1), bool), (size > 1)[:, None]], axis=1)
        return words[used].astype(self.word).tobytes()
