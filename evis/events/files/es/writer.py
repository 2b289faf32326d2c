"""Writes Event Streams of type dvs."""

from __future__ import annotations

import os

import numpy as np

from evis.events.arrays import Events
from evis.events.codecs.encoder import REBASE
from evis.events.files.es.layout import EVENT_BYTES, MAGIC, TIME_SHIFT, TYPES, VERSION, longest_time
from evis.events.files.file_writer import FileWriter, check_size, refuse_encoding
from evis.events.recording import RecordingError

_SHIFT = TIME_SHIFT["dvs"]
_LONGEST_US = longest_time(_SHIFT)
_PAUSE = _LONGEST_US << _SHIFT | 1
_MAX_PAUSE_US = 4 * 3600 * 10**6
"""A pause takes a byte for each of its longest times: this one 113 MB."""


class EsWriter(FileWriter):
    """Writes .es 2.0. Times are rounded down to whole us and must not step back."""

    def __init__(self, path: str | os.PathLike[str], width: int, height: int) -> None:
        super().__init__(path)
        self._last = 0
        self._file = self.partial.open("wb")
        kind = next(number for number, name in TYPES.items() if name == "dvs")
        self._file.write(MAGIC + bytes((*VERSION, kind)) + width.to_bytes(2, "little") + height.to_bytes(2, "little"))

    def write(self, events: Events) -> None:
        for first in range(0, len(events), 1 << 18):
            self._write(events[first : first + (1 << 18)])

    def _write(self, events: Events) -> None:
        t = events.t // 1000
        step = np.diff(t, prepend=self._last)
        if int(t[0]) < 0:
            raise RecordingError(
                f"{self.path}: .es counts from 0, and cannot hold the negative time {events.t[0]} ns; {REBASE}"
            )
        if int(step.min()) < 0:
            raise RecordingError(f"{self.path}: .es cannot hold times that step back; sort the events, or write .npz")
        if int(step.max()) > _MAX_PAUSE_US:
            raise RecordingError(
                f"{self.path}: .es counts from 0, a byte for each {_LONGEST_US} us: "
                f"{int(step.max()) / 1e6:.0f} s is too long; {REBASE}"
            )
        pauses = step // _LONGEST_US
        end = np.cumsum(pauses + EVENT_BYTES)
        out = np.full(int(end[-1]), _PAUSE, np.uint8)
        out[end - EVENT_BYTES] = (step % _LONGEST_US) << _SHIFT | events.p
        for behind, value in ((4, events.x & 0xFF), (3, events.x >> 8), (2, events.y & 0xFF), (1, events.y >> 8)):
            out[end - behind] = value
        self._file.write(out.tobytes())
        self._last = int(t[-1])


def create(path: str | os.PathLike[str], width: int, height: int, encoding: str = "") -> EsWriter:
    """Returns an .es writer. Raises RecordingError."""
    refuse_encoding(path, encoding, ".es")
    check_size(path, ".es", width, height, 65535)
    return EsWriter(path, width, height)
