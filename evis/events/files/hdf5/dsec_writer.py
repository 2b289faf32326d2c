"""Writes a recording as one file of DSEC, with its index by the millisecond."""

from __future__ import annotations

import os

import numpy as np

from evis.events.arrays import Events
from evis.events.files.file_writer import FileWriter
from evis.events.files.hdf5.dsec_events import EventFile, TooLongError
from evis.events.recording import RecordingError


class DsecEventsWriter(FileWriter):
    """Writes .h5 as DSEC has it. Times are rounded down to whole us, count from the first event, whose own is
    `t_offset`, and must not step back."""

    _file: EventFile

    def __init__(self, path: str | os.PathLike[str], width: int, height: int) -> None:
        super().__init__(path)
        self._end_ns: int | None = None
        self._file = EventFile(self.partial)
        self._file.note_size(width, height)

    def write(self, events: Events) -> None:
        if not len(events):
            return
        since = events.t[0] if self._end_ns is None else self._end_ns
        if (np.diff(events.t, prepend=since) < 0).any():
            raise RecordingError(f"{self.path}: DSEC's index cannot hold times that step back; sort the events")
        try:
            self._file.add(events)
        except TooLongError as error:
            raise RecordingError(f"{self.path}: {error}; take a part with --from and --to, or write .npz") from None
        self._end_ns = int(events.t[-1])

    def _finish(self) -> None:
        self._file.finish(0 if self._end_ns is None else self._end_ns + 1)
