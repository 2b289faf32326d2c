"""Reads N-MNIST and N-Caltech101 `.bin`: 5 bytes an event (x, y, polarity and 23 bits of time in us), nothing else."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from evis.events.arrays import Events
from evis.events.files.reading.block_recording import take_size
from evis.events.files.reading.record_file import RecordFile
from evis.events.recording import OpenOptions, RecordingInfo

NAME = "N-MNIST .bin"

SENSORS = ((34, 34), (304, 240))
"""The saccade data sets: N-MNIST's crop, and the whole ATIS."""
_RECORD = np.dtype([("x", "u1"), ("y", "u1"), ("t", "u1", 3)])
_OVERFLOW_ROW = 240
_OVERFLOW_US = 1 << 13
_SURE = 32


def matches(head: bytes, path: Path, name: str) -> bool:
    """Tells whether the bytes make sense as events, as there is no signature: the times of the first events must run
    forward; a file of another name must show many."""
    records = np.frombuffer(head, _RECORD, len(head) // _RECORD.itemsize)
    named = name.lower().endswith(".bin")
    if len(records) < (1 if named else _SURE):
        return False
    t = _times(records)
    step = np.diff(t)
    forward = np.mean((step >= 0) | (step < -(1 << 22))) if len(t) > 1 else 1.0
    # padding, text and pictures repeat themselves more
    lively = len(np.unique(t)) > len(t) // 4 and len(np.unique(records["x"])) > 8
    return bool(forward >= 0.98 and (lively or named) and records["y"].max(initial=0) <= _OVERFLOW_ROW)


def _times(records: np.ndarray) -> np.ndarray:
    parts = records["t"].astype(np.int64)
    return (parts[:, 0] & 0x7F) << 16 | parts[:, 1] << 8 | parts[:, 2]


class NmnistRecording(RecordFile):
    """Reads a `.bin` file. A record in row 240 is no event: from there on the counter is 2^13 us short."""

    record = _RECORD
    counter_bits = 23

    def __init__(self, path: Path, options: OpenOptions) -> None:
        self.info = RecordingInfo(str(path), "nmnist", "", 0, 0, "", path.stat().st_size)
        self._open_records(path, 0)
        try:
            if not take_size(self.info, options):
                before = list(self.info.warnings)
                self._size_from_events(SENSORS)
                self.info.warnings = before  # the format never has a size
        except BaseException:
            self.close()
            raise
        super().__init__()

    def _counter(self, records: np.ndarray) -> np.ndarray:
        return _times(records)

    def _load_from(self, t_ns: int) -> Iterator[Events]:
        return self._load()  # what the marks add is known only from the start on

    def _unwrap(self, counter: np.ndarray, before: tuple[int, int] | None) -> np.ndarray:
        if before is None:
            self._late_us = 0
        return super()._unwrap(counter, before)

    def _events(self, records: np.ndarray, t_us: np.ndarray) -> Events:
        mark = records["y"] == _OVERFLOW_ROW
        late = self._late_us + _OVERFLOW_US * np.cumsum(mark)
        self._late_us = int(late[-1])
        keep = ~mark
        records, t_us = records[keep], (t_us + late)[keep]
        x, y, p = records["x"].astype(np.uint16), records["y"].astype(np.uint16), records["t"][:, 0] >> 7
        return Events(t_us * 1000, x, y, p)


def open_file(path: Path, options: OpenOptions) -> NmnistRecording:
    """Opens a `.bin` file. Raises RecordingError."""
    return NmnistRecording(path, options)
