"""Reads and writes Prophesee DAT: lines of `% key value`, two bytes (type, size), then 8 bytes an event: u32 t [us],
u32 x, y, p.

Old files lack text and type, or have (`Version` below 2) x in bits 0-8, y in 9-16 and p in bit 17.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np

from evis.events.arrays import Events, Triggers
from evis.events.codecs.encoder import REBASE
from evis.events.files.file_writer import FileWriter, check_size, refuse_encoding
from evis.events.files.reading.block_recording import take_size
from evis.events.files.reading.header_lines import is_cut_line
from evis.events.files.reading.record_file import RecordFile
from evis.events.recording import HEAD, OpenOptions, RecordingError, RecordingInfo

NAME = "Prophesee DAT"

TYPES = {0x00: "2d", 0x0C: "cd", 0x0E: "trigger"}
"""Event type of the file -> name. Triggers have the value in bits 0-3 and the channel in 26-31."""
_RECORD = np.dtype([("t", "<u4"), ("word", "<u4")])
_SIDE = 1 << 14
_OLD, _NEW = (9, 17, 0x1FF, 0xFF), (14, 28, _SIDE - 1, _SIDE - 1)
"""Where y and p begin in the word, and the largest x and y."""
_LARGEST_SENSOR = 2048


def matches(head: bytes, path: Path, name: str) -> bool:
    """Tells whether a file is a DAT file: the first header line names the format; older files have the extension alone,
    and perhaps no header.
    """
    if head.startswith(b"% Data file"):
        return True
    return name.lower().endswith(".dat") and (head.startswith(b"% ") or _bare(head))


def _bare(head: bytes) -> bool:
    """Tells whether a file has records from the first byte on: their times go up, and the pixels are on a sensor."""
    records = np.frombuffer(head, _RECORD, len(head) // _RECORD.itemsize)
    t = records["t"].astype(np.int64)
    return len(t) >= 8 and bool((np.diff(t) >= 0).mean() > 0.9) and _fits(records["word"], _NEW, 0, 0)


def _fits(words: np.ndarray, layout: tuple[int, int, int, int], width: int, height: int) -> bool:
    y_bit, p_bit, most_x, most_y = layout
    x, y = words & most_x, words >> y_bit & most_y
    spare = words >> p_bit > 1
    wrong = spare | (x >= (width or _LARGEST_SENSOR)) | (y >= (height or _LARGEST_SENSOR))
    return bool(wrong.mean() < 0.02) if len(words) else True


class DatRecording(RecordFile):
    """Reads a DAT file. Bits of the word: x 0-13, y 14-27, p 28; in the old layout x 0-8, y 9-16, p 17."""

    record = _RECORD
    counter_bits = 32

    def __init__(self, path: Path, options: OpenOptions) -> None:
        size = path.stat().st_size
        header, at, binary = read_header(path)
        self.info = RecordingInfo(str(path), "dat", "", 0, 0, "header", size, header=header)
        if len(binary) < 2:
            self.info.truncated = True
            self.info.warn("cut inside the header: there is no event")
            binary = bytes((0x0C, 8))
        elif not header:
            at, binary = -2, bytes((0, 8))
        kind, length = binary[0], binary[1]
        if kind not in TYPES or length != self.record.itemsize:
            raise RecordingError(
                f"{path}: a DAT file of event type 0x{kind:02X} with {length} bytes each; known are "
                + " and ".join(f"0x{k:02X} ({v}) with 8" for k, v in TYPES.items())
            )
        self.info.encoding = TYPES[kind]
        self._open_records(path, min(at + 2, size))
        try:
            width, height = (_number(header.get(k, "")) for k in ("width", "height"))
            if not take_size(self.info, options):
                self.info.width, self.info.height = (width, height) if width and height else (0, 0)
            self._layout = self._find_layout(header.get("version", ""))
            if not self.info.width and self.info.encoding != "trigger":
                self._size_from_events()
        except BaseException:
            self.close()
            raise
        super().__init__()

    def _find_layout(self, version: str) -> tuple[int, int, int, int]:
        """Finds the layout of the words by the version, unless the first events fit the other one alone."""
        words = self._records(0, min(self._total, 1 << 16))["word"] if self._total else np.empty(0, np.uint32)
        named, other = (_OLD, _NEW) if version in ("0", "1") else (_NEW, _OLD)
        size = self.info.width, self.info.height
        return other if not _fits(words, named, *size) and _fits(words, other, *size) else named

    def _counter(self, records: np.ndarray) -> np.ndarray:
        return records["t"].astype(np.int64)

    def _events(self, records: np.ndarray, t_us: np.ndarray) -> Events:
        word, t = records["word"], t_us * 1000
        if self.info.encoding == "trigger":
            events = Events.empty()
            events.triggers = Triggers(t, (word >> 26).astype(np.uint8), (word & 15 != 0).view(np.uint8))
            return events
        y_bit, p_bit, most_x, most_y = self._layout
        x, y, p = word & most_x, word >> y_bit & most_y, word >> p_bit & 1
        return Events(t, x.astype(np.uint16), y.astype(np.uint16), p.astype(np.uint8))


def read_header(path: Path) -> tuple[dict[str, str], int, bytes]:
    """Reads the header: keys in lower case, the position behind the text, and the two bytes there, which a file that
    was cut before them lacks.
    """
    header: dict[str, str] = {}
    with path.open("rb") as file:
        position = 0
        while position < 1 << 20:
            line = file.readline(HEAD)
            # the two bytes after the text may look like anything but a whole line of text
            if is_cut_line(line, b"%") and not file.read(1):
                position += len(line)
                break
            if not line.startswith(b"%") or not line.endswith(b"\n"):
                break
            position += len(line)
            key, _, value = line[1:].decode("latin-1").strip().partition(" ")
            header[key.lower()] = value.strip()
        file.seek(position)
        return header, position, file.read(2)


def _number(text: str) -> int:
    return int(text) if re.fullmatch(r"\d{1,5}", text) and int(text) <= _SIDE else 0


def open_file(path: Path, options: OpenOptions) -> DatRecording:
    """Opens a DAT file. Raises RecordingError."""
    return DatRecording(path, options)


class DatWriter(FileWriter):
    """Writes CD events. Times are rounded down to whole us, of which the format holds the low 32 bits."""

    def __init__(self, path: str | os.PathLike[str], width: int, height: int) -> None:
        super().__init__(path)
        self._last = -1
        self._file = self.partial.open("wb")
        self._file.write(
            f"% Data file containing CD events.\n% Version 2\n% Height {height}\n% Width {width}\n".encode()
            + b"\x0c\x08"
        )

    def write(self, events: Events) -> None:
        if not len(events):
            return
        t = events.t // 1000
        steps = np.diff(t, prepend=self._last if self._last >= 0 else t[0])
        if int(t.min()) < 0 or (self._last < 0 and int(t[0]) >= 1 << 32):
            raise RecordingError(f"{self.path}: DAT counts from 0 to 4294 s; {REBASE}")
        if int(np.abs(steps).max()) >= 1 << 31:
            longest = int(np.abs(steps).max()) / 1e6
            raise RecordingError(f"{self.path}: DAT cannot hold a pause of {longest:.0f} s; write .npz")
        if max(int(events.x.max()), int(events.y.max())) >= _SIDE:
            raise RecordingError(f"{self.path}: DAT holds coordinates up to {_SIDE - 1}")
        records = np.empty(len(t), _RECORD)
        records["t"] = t & 0xFFFFFFFF
        records["word"] = events.x | events.y.astype(np.uint32) << 14 | events.p.astype(np.uint32) << 28
        self._file.write(records.tobytes())
        self._last = int(t[-1])


def create(path: str | os.PathLike[str], width: int, height: int, encoding: str = "") -> DatWriter:
    """Returns a DAT writer. Raises RecordingError."""
    refuse_encoding(path, encoding, ".dat")
    check_size(path, "DAT", width, height, _SIDE)
    return DatWriter(path, width, height)
