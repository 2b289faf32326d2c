"""Implements what DAVIS and DVXplorer share: 16-bit words with 15-bit times, triggers, and the words of other parts of
the sensor.

A word with bit 15 is a time: us since the last wrap. Otherwise bits 12-14 are a code and bits 0-11 its data. Code 7
moves the base of the times by 2^15 us times its data; special word 1 (timestamp reset) sets base and time to 0. Code 0
is a special word, code 5 holds 8-bit pieces (inertial samples, region of interest).

Trigger channels: 0 the input's edges, 1 the generator's edges, 2 the input's pulses (value 1).
"""

from __future__ import annotations

import abc
from typing import ClassVar

import numpy as np

from evis.events.arrays import Events, Triggers
from evis.events.codecs import decoder

TIME, WRAP, RESET, ADDRESS, EVENT, TRIGGER, SIDE, IGNORED, UNKNOWN = range(9)
"""Classes of words: up to RESET they carry the time, from EVENT on they happen at a time."""

CODE_SHIFT, DATA_MASK = 12, 0xFFF
SPECIAL_CODE, PIECE_CODE, WRAP_CODE, TIME_CODES = 0, 5, 7, 8
"""Codes of words; from TIME_CODES on, all are times."""
RESET_WORD = 1
TIME_MASK = 0x7FFF
WRAP_SHIFT = 15
WRAP_US = 1 << WRAP_SHIFT
MAX_OFFSET_US = 1 << 52
"""Base of the times where counting stops: 142 years, before int64 ns overflow."""
INPUT_FALLING, INPUT_RISING, INPUT_PULSE, GENERATOR_FALLING, GENERATOR_RISING = 2, 3, 4, 16, 17
TRIGGERS = {
    INPUT_FALLING: (0, 0),
    INPUT_RISING: (0, 1),
    INPUT_PULSE: (2, 1),
    GENERATOR_FALLING: (1, 0),
    GENERATOR_RISING: (1, 1),
}
"""Special word -> (channel, value)."""
IMU_START, IMU_END = 5, 7

# places in the state vector, shared with the kernels; addresses follow from STATE on
TIMED, OFFSET, NOW, OUTSIDE, UNTIMED, UNKNOWNS, RESETS, IMU_DAMAGED, FRAMES_DAMAGED, STATE = range(10)

_TRIGGER_ID = np.zeros(18, np.uint8)
_TRIGGER_VALUE = np.zeros(18, np.uint8)
for _word, (_id, _value) in TRIGGERS.items():
    _TRIGGER_ID[_word], _TRIGGER_VALUE[_word] = _id, _value


def classes(codes: dict[int, int], specials: dict[int, int], pieces: dict[int, int]) -> np.ndarray:
    """Tabulates the class of each of the 65536 words: by code, by special word, and by sub-code of the 8-bit pieces."""
    words = np.arange(1 << 16)
    code, data = words >> CODE_SHIFT, words & DATA_MASK
    table = np.full(1 << 16, UNKNOWN, np.uint8)
    for of_code, kind in codes.items():
        table[code == of_code] = kind
    for piece, kind in pieces.items():
        table[words >> 8 == PIECE_CODE << 4 | piece] = kind
    for special, kind in {RESET_WORD: RESET, **dict.fromkeys(TRIGGERS, TRIGGER), **specials}.items():
        table[(code == SPECIAL_CODE) & (data == special)] = kind
    table[code == WRAP_CODE] = WRAP
    table[code >= TIME_CODES] = TIME
    return table


class Decoder(decoder.Decoder):
    """Decodes the time, triggers and side words; subclasses add the events."""

    word = np.dtype("<u2")
    wrap_ns = WRAP_US * 1000
    counters = {
        "outside": OUTSIDE,
        "untimed": UNTIMED,
        "unknown": UNKNOWNS,
        "timestamp_resets": RESETS,
        "imu_damaged": IMU_DAMAGED,
        "frames_damaged": FRAMES_DAMAGED,
    }
    has_side = True
    kinds: ClassVar[np.ndarray]
    imu_orientation = 0
    """How the inertial chip is mounted, see ImuReader; holds from the next reset on."""

    def decode_words(self, words: np.ndarray, limit: int) -> tuple[Events, int, int]:
        """Decodes words by numpy, the twin of the kernel: the class of each word from a table, what holds at it by
        counting.
        """
        state, skipped = self.state, 0
        kind = self.kinds[words]
        if state[TIMED] <= 0:
            first = np.flatnonzero(kind <= RESET)
            skipped = int(first[0]) if len(first) else len(words)
            state[UNTIMED] += skipped
            words, kind = words[skipped:], kind[skipped:]
        if not len(words):
            return Events.empty(), skipped, -1
        at, offset, now = self._clock(words, kind)
        timed = np.flatnonzero(kind >= EVENT)
        times = now[decoder.count_until(kind <= RESET, timed)]
        late = times > limit
        following, cut = -1, len(words)
        if late.any():
            i = int(np.argmax(late))
            following, cut = int(times[i]), int(timed[i])
            words, kind, timed, times = words[:cut], kind[:cut], timed[:i], times[:i]
        j = int(np.searchsorted(at, cut))
        state[TIMED], state[OFFSET], state[NOW] = 1, offset[j], now[j]
        state[RESETS] += np.count_nonzero(kind == RESET)
        state[UNKNOWNS] += np.count_nonzero(kind == UNKNOWN)
        of = kind[timed]
        events = self._events(words, kind, timed[of == EVENT], times[of == EVENT])
        if (edge := of == TRIGGER).any():
            word = words[timed[edge]]
            events.triggers = Triggers(times[edge] * 1000, _TRIGGER_ID[word], _TRIGGER_VALUE[word])
        side = np.flatnonzero((kind == SIDE) | (kind == RESET))
        if len(side):
            self._assemble(events, now[decoder.count_until(kind <= RESET, side)], words[side])
        return events, skipped + cut, following

    def _clock(self, words: np.ndarray, kind: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Finds the words that carry time; returns their places, and base and time [us] before the first and after
        each."""
        at = np.flatnonzero(kind <= RESET)
        is_wrap, is_reset = kind[at] == WRAP, kind[at] == RESET
        data = words[at].astype(np.int64)
        total = self.state[OFFSET] + np.cumsum(np.where(is_wrap, (data & DATA_MASK) * WRAP_US, 0))
        last = np.maximum.accumulate(np.where(is_reset, np.arange(len(at)), -1))
        offset = np.minimum(np.where(last >= 0, total - total[last], total), MAX_OFFSET_US)
        now = offset + np.where(kind[at] == TIME, data & TIME_MASK, 0)
        return at, np.append(self.state[OFFSET], offset), np.append(self.state[NOW], now)

    @abc.abstractmethod
    def _events(self, words: np.ndarray, kind: np.ndarray, at: np.ndarray, times: np.ndarray) -> Events:
        """Decodes the events of the words `at`; returns them and the address part of the state after all words."""
