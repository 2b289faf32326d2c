"""Writes events as text: `.csv` with a header line and times in ns, `.txt` as `t x y p` with t in seconds.

Neither has the sensor's size: a line before the events would be one too many for most programs that read such files.
"""

from __future__ import annotations

import os

from evis.events.arrays import Events
from evis.events.files.file_writer import FileWriter, refuse_encoding

_ROWS = 1 << 16


class TextWriter(FileWriter):
    """Writes one line per event. Seconds have nine digits, so that they are exact."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        super().__init__(path)
        self._csv = self.path.suffix.lower() == ".csv"
        self._file = self.partial.open("w", encoding="ascii", newline="\n")
        if self._csv:
            self._file.write("t,x,y,p\n")
        self._empty = True

    def write(self, events: Events) -> None:
        self._empty = self._empty and not len(events)
        for start in range(0, len(events), _ROWS):
            part = events[start : start + _ROWS]
            rows = zip(part.t.tolist(), part.x.tolist(), part.y.tolist(), part.p.tolist())
            if self._csv:
                self._file.writelines(f"{t},{x},{y},{p}\n" for t, x, y, p in rows)
            else:
                self._file.writelines(f"{_seconds(t)} {x} {y} {p}\n" for t, x, y, p in rows)

    def _finish(self) -> None:
        if self._empty and not self._csv:
            self._file.write("# t x y p\n")  # or nothing would tell what it is
        super()._finish()


def _seconds(t: int) -> str:
    """Writes a time [ns] as seconds, exactly."""
    whole, part = divmod(abs(t), 1_000_000_000)
    return f"{'-' if t < 0 else ''}{whole}.{part:09d}"


def create(path: str | os.PathLike[str], width: int, height: int, encoding: str = "") -> TextWriter:
    """Returns a text writer. Raises RecordingError."""
    refuse_encoding(path, encoding, "text")
    return TextWriter(path)
