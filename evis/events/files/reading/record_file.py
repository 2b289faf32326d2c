"""Reads files that are a header and then records of one size, each with a time counter that wraps around."""

from __future__ import annotations

import abc
import os
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np

from evis.events.arrays import Events
from evis.events.files.reading.bisection import place_before
from evis.events.files.reading.block_recording import BlockRecording
from evis.events.files.reading.zero_tail import data_end
from evis.events.recording import RecordingError
from evis.files.descriptor import DescriptorOwner

BLOCK = 1 << 18
"""Records in a block."""
SAMPLES = 4096
SCAN_RECORDS = 8 << 20
"""Files with more records than this are bisected by time, where their times allow it."""


class RecordFile(DescriptorOwner, BlockRecording):
    """Reads records of one size from byte `start` on, in blocks at their place in the file.

    A subclass sets `info` (with the path) and calls `_open_records`.
    """

    record: np.dtype
    counter_bits: ClassVar[int]

    def _open_records(self, path: Path, start: int) -> None:
        self._path, self._start = path, start
        self._descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        data = data_end(self._descriptor, start, self.info, self.record.itemsize) - start
        self._total, rest = divmod(max(data, 0), self.record.itemsize)
        self._done = 0
        if rest:
            self.info.truncated = True
            self.info.warn(f"cut inside a record: the last {rest} bytes hold no event")

    @abc.abstractmethod
    def _counter(self, records: np.ndarray) -> np.ndarray:
        """Returns the time counter of each record, int64."""

    @abc.abstractmethod
    def _events(self, records: np.ndarray, t_us: np.ndarray) -> Events:
        """Converts records to events; t_us int64 with the counter's turns."""

    def _records(self, first: int, count: int) -> np.ndarray:
        size = self.record.itemsize
        data = os.pread(self._descriptor, count * size, self._start + first * size)
        if len(data) < count * size and not len(data) // size:
            raise RecordingError(f"{self._path}: the file became shorter while it was read")
        return np.frombuffer(data, self.record, len(data) // size)

    def _unwrap(self, counter: np.ndarray, before: tuple[int, int] | None) -> np.ndarray:
        """Computes times [us] from the counter. before: (counter, time) of the record before, None at the start.

        A fall by more than half the counter's range is a turn of it. A rise by nearly all of the range, after a turn,
        is an event from before the turn that came late; any other step is kept as it is.
        """
        span = 1 << self.counter_bits
        last_counter, last_t = before if before else (int(counter[0]), int(counter[0]))
        step = np.diff(counter, prepend=last_counter)
        turns = np.cumsum(step < -span // 2)
        late = (step > span - span // 64) & (turns * span + last_t - last_counter > 0)
        return counter + (turns - np.cumsum(late)) * span + (last_t - last_counter)

    def _load(self) -> Iterator[Events]:
        return self._load_at(0, None)

    def _load_at(self, first: int, before: tuple[int, int] | None) -> Iterator[Events]:
        while first < self._total:
            records = self._records(first, min(BLOCK, self._total - first))
            counter = self._counter(records)
            t_us = self._unwrap(counter, before)
            before = int(counter[-1]), int(t_us[-1])
            first += len(records)
            self._done = first
            yield self._events(records, t_us)

    def _load_from(self, t_ns: int) -> Iterator[Events]:
        """Yields blocks from a record found by bisection; from the start where the file is small or its counter
        wraps."""
        if self._total <= SCAN_RECORDS:
            return self._load()
        samples = np.unique(np.linspace(0, self._total - 1, SAMPLES).astype(np.int64))
        counters = np.array([self._counter_at(int(i)) for i in samples])
        if (np.diff(counters) < 0).any():
            return self._load()  # the counter turns
        place = int(np.searchsorted(counters, t_ns // 1000))
        low, high = int(samples[max(place - 1, 0)]), int(samples[min(place, len(samples) - 1)])
        found = place_before(low, high, BLOCK, lambda record: self._counter_at(record) < t_ns // 1000)
        counter = self._counter_at(found)
        return self._load_at(found, (counter, counter))

    def _counter_at(self, i: int) -> int:
        return int(self._counter(self._records(i, 1))[0])

    @property
    def position(self) -> float:
        return self._done / self._total if self._total else 1.0
