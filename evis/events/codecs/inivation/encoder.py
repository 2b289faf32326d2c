"""Implements what the DAVIS and DVXplorer encoders share: groups of events as words, blocks of other words,
time words."""

from __future__ import annotations

import abc

import numpy as np

from evis.events.arrays import Events
from evis.events.codecs.encoder import REBASE
from evis.events.codecs.encoder import Encoder as _Encoder
from evis.events.codecs.inivation.imu import ImuChip
from evis.events.codecs.inivation.words import TRIGGERS

MAX_WRAP = 4095
"""Wraps that one word can count."""
MAX_WRAP_WORDS = 20_000
"""Wrap words in a row (a month) beyond which times do not count from the device's start."""
_SPECIALS = {pair: special for special, pair in TRIGGERS.items()}


class Encoder(_Encoder):
    """Encodes events, triggers and inertial samples as words; subclasses say how events become words."""

    word = np.dtype("<u2")
    channels = 3
    imu: ImuChip

    def __init__(self, resync: bool = False) -> None:
        super().__init__(resync)
        self._t_us: int | None = None
        self._forget_addresses()

    def _forget_addresses(self) -> None:
        """Resets the addresses, so that the next words send them."""

    def encode(self, events: Events) -> bytes:
        """Encodes events as words in stream order; triggers and samples before the first event that is later."""
        self._check(events)
        blocks = sorted(self._blocks(events), key=lambda block: block[0])
        if not len(events) and not blocks:
            return b""
        if self.resync:
            self._forget_addresses()
        heads, cells, used = self._cells(events, events.t // 1000)
        head_t = events.t[heads] // 1000
        block_t = np.array([t for t, _ in blocks], np.int64)
        place = np.searchsorted(np.maximum.accumulate(head_t), block_t, "right")
        t_us = np.insert(head_t, place, block_t)
        is_block = np.insert(np.zeros(len(heads), bool), place, True)

        before = np.append(0 if self._t_us is None else self._t_us, t_us[:-1])
        new = t_us != before
        new[0] |= self._t_us is None or self.resync
        turns = (t_us >> 15) - (before >> 15)
        if turns.min() < 0:
            i = int(np.argmin(turns))
            raise ValueError(
                f"{self.encoding} cannot hold a time that steps back by {before[i] - t_us[i]} us over a turn of its "
                "counter (32.8 ms); sort the events by time or write .npz"
            )
        whole = np.maximum(turns - 1, 0) // MAX_WRAP
        if whole.sum() > MAX_WRAP_WORDS:
            raise ValueError(
                f"{self.encoding} counts from 0 in turns of 32.8 ms; a jump to {t_us.max() / 1e6:.6g} s is too far; "
                f"{REBASE}"
            )
        out = np.zeros((len(t_us), 2 + cells.shape[1]), np.int64)
        use = np.zeros(out.shape, bool)
        out[:, 0], use[:, 0] = 0x7000 | turns - whole * MAX_WRAP, turns > 0
        out[:, 1], use[:, 1] = 0x8000 | t_us & 0x7FFF, new
        out[~is_block, 2:], use[~is_block, 2:] = cells, used
        ends = np.cumsum(use.sum(axis=1))
        flat = out[use]
        # blocks go behind the time of their item, further wraps before all words of theirs
        jumps = np.flatnonzero(whole)
        pieces = [words for _, words in blocks] + [np.full(whole[i], 0x7000 | MAX_WRAP) for i in jumps]
        if pieces:
            at = np.concatenate([ends[is_block], (ends - use.sum(axis=1))[jumps]])
            order = np.argsort(at, kind="stable")
            flat = np.insert(
                flat, np.repeat(at[order], [len(pieces[i]) for i in order]), np.concatenate([pieces[i] for i in order])
            )
        self._t_us = int(t_us[-1])
        return flat.astype(self.word).tobytes()

    def advance(self, t_ns: int) -> bytes:
        """Encodes the wrap words up to t_ns, as a device without events sends them."""
        turns = (t_ns // 1000 >> 15) - ((self._t_us or 0) >> 15)
        if turns <= 0:
            return b""
        if turns > MAX_WRAP * MAX_WRAP_WORDS:
            raise ValueError(f"{self.encoding} counts from 0 in turns of 32.8 ms; {t_ns / 1e9:.6g} s is too far")
        self._t_us = t_ns // 1000 >> 15 << 15
        whole, rest = divmod(turns, MAX_WRAP)
        return np.array([0x7000 | MAX_WRAP] * whole + [0x7000 | rest] * (rest > 0), self.word).tobytes()

    def _blocks(self, events: Events) -> list[tuple[int, np.ndarray]]:
        edges, imu = events.triggers, events.imu
        blocks = []
        for t, channel, value in zip(edges.t.tolist(), edges.id.tolist(), edges.value.tolist()):
            if (channel, value) not in _SPECIALS:
                raise ValueError(f"{self.encoding}: a pulse (trigger channel 2) has the value 1, not {value}")
            blocks.append((t // 1000, np.array([_SPECIALS[channel, value]])))
        for i, t in enumerate(imu.t.tolist()):
            words = self.imu.words(imu.acceleration[i], imu.angular_velocity[i], float(imu.temperature[i]))
            blocks.append((t // 1000, words))
        if blocks and min(t for t, _ in blocks) < 0:
            raise ValueError(f"{self.encoding} cannot hold negative times; {REBASE}")
        return blocks

    def _check_samples(self, events: Events) -> None:
        if events.frames:
            raise ValueError(f"{self.encoding} has no frames")

    @abc.abstractmethod
    def _cells(self, events: Events, t_us: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Groups of events that share words: first events int64 [n], words int64 [n, k], and which are sent."""
