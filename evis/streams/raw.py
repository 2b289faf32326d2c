"""Prophesee RAW: lines `% key value`, then the words as they came over the wire."""

from __future__ import annotations

import importlib
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np

from evis.streams.decoder import CODECS, backend_for, make_decoder
from evis.streams.encoder import Encoder
from evis.streams.events import Events
from evis.streams.recording import Recording, RecordingError, RecordingInfo, Writer

NAME = "Prophesee RAW (EVT2, EVT3)"

SYSTEMS = {
    0x15: ("Gen3", 640, 480),
    0x1C: ("Gen3.1 CCAM3", 640, 480),
    0x28: ("EVK3 Gen3.1", 640, 480),
    0x30: ("EVK3 Gen4.1", 1280, 720),
    0x31: ("EVK3 IMX636", 1280, 720),
    0x32: ("EVK2 IMX636", 1280, 720),
    0x35: ("IMX646", 1280, 720),
    0x3B: ("GenX320", 320, 320),
    0x40: ("GenX320", 320, 320),
}
"""system_ID of the header -> name, width, height, for headers without a geometry."""

_EVT = {"2.0": "evt2", "2.1": "evt21", "3.0": "evt3", "4.0": "evt4"}
_KEYS = {"evt", "format", "geometry", "system_id", "serial_number", "sensor_generation", "sensor_name", "plugin_name"}
_LEGAL = {"evt2": ((0, 1, 8, 10, 14, 15), 28), "evt3": ((0, 2, 3, 4, 5, 6, 7, 8, 10, 14, 15), 12)}
_MAX_HEADER = 1 << 20
_MAX_LINE = 4096
_PRINTABLE = re.compile(rb"[\t\x20-\x7e]*")
# numpy decodes the whole rest of a block for each cut in time: small blocks there
_BLOCK = {"numpy": 1 << 19, "warp": 1 << 22}
_WINDOW_BLOCK = {"numpy": 1 << 15, "warp": 1 << 22}


def matches(head: bytes) -> bool:
    """A header line, and not the one of the DAT format."""
    return head.startswith(b"% ") and not head.startswith(b"% Data file")


def read_header(file: BinaryIO) -> tuple[dict[str, str], int]:
    """Header keys in lower case, and the position of the first word.

    The header ends with `% end`, or before the first line that does not start with `% ` (old files).
    """
    header: dict[str, str] = {}
    position = 0
    while position < _MAX_HEADER:
        line = file.readline(_MAX_LINE)
        text = line.rstrip(b"\r\n")
        if not line.startswith(b"% ") or not line.endswith(b"\n") or not _PRINTABLE.fullmatch(text):
            break
        position += len(line)
        key, _, value = text[2:].decode("ascii").strip().partition(" ")
        if key.lower() == "end" and not value:
            break
        header[key.lower()] = value.strip()
    file.seek(position)
    return header, position


class RawRecording(Recording):
    """A RAW file. Nothing but the current block is in memory."""

    def __init__(self, path: Path, backend: str = "auto") -> None:
        self._file = path.open("rb")
        try:
            self._open(path, backend)
        except BaseException:
            self._file.close()
            raise

    def _open(self, path: Path, backend: str) -> None:
        header, self._start = read_header(self._file)
        size = os.fstat(self._file.fileno()).st_size
        if not _KEYS & header.keys():
            raise RecordingError(f"{path}: damaged RAW header: none of {', '.join(sorted(_KEYS))} in it")
        encoding = _encoding(header)
        if not encoding:
            encoding = guess_encoding(self._file.read(1 << 16))
            self._file.seek(self._start)
        if encoding not in CODECS:
            what = f"its encoding {encoding} is not supported" if encoding else "no encoding in the header or the data"
            raise RecordingError(f"{path}: {what}; supported are {', '.join(CODECS)}")
        self._size = size
        self._backend = backend_for(size) if backend == "auto" else backend
        self.info = RecordingInfo(str(path), "raw", encoding, 0, 0, "", size, header=header)
        self.info.serial = header.get("serial_number", "")
        self.info.sensor = header.get("sensor_name", header.get("sensor_generation", ""))
        self._decoder = make_decoder(encoding, 0, 0, self._backend)
        rest = (size - self._start) % self._decoder.word.itemsize
        if rest:
            self.info.truncated = True
            self.info.warnings.append(f"cut inside a word: the last {rest} bytes hold no event")
        if size == self._start:
            self.info.warnings.append("no data after the header")
        self._set_geometry(header)
        self._decoder = make_decoder(encoding, self.info.width, self.info.height, self._backend)
        self._raw: list[np.ndarray] = []
        self._ahead: list[np.ndarray] = []

    def _set_geometry(self, header: dict[str, str]) -> None:
        info = self.info
        info.width, info.height = _geometry(header, info.warnings)
        info.geometry_from = "header"
        if info.width:
            return
        system = SYSTEMS.get(int(header["system_id"]) if header.get("system_id", "").isdecimal() else -1)
        if system:
            name, info.width, info.height = system
            info.sensor = info.sensor or name
            info.geometry_from = "system_ID"
            return
        for events in self.blocks():
            if len(events):
                info.width = max(info.width, int(events.x.max()) + 1)
                info.height = max(info.height, int(events.y.max()) + 1)
        self._file.seek(self._start)
        info.geometry_from = "events"
        info.warnings.append(f"no geometry in the header: {info.width}x{info.height} are the largest coordinates")

    def _feed(self, size: int) -> bool:
        try:
            data = self._file.read(size)
        except OSError as e:
            raise RecordingError(f"{self.info.path}: reading failed: {e.strerror}") from None
        if data:
            self._decoder.feed(data)
        return bool(data)

    def blocks(self) -> Iterator[Events]:
        more = self._decoder.pending >= self._decoder.word.itemsize or self._feed(_BLOCK[self._backend])
        while more:
            yield self._decoder.decode()
            more = self._feed(_BLOCK[self._backend])

    def read_until(self, t_ns: int) -> Events:
        parts, self._raw, self._ahead = [], self._ahead, []
        while True:
            parts.append(self._decoder.decode_until(t_ns))
            self._raw.append(self._decoder.taken)
            if self._decoder.at_cut or not self._feed(_WINDOW_BLOCK[self._backend]):
                return Events.concatenate(parts)

    @property
    def next_t_ns(self) -> int | None:
        if not self._decoder.at_cut:
            # no event is earlier than this: only words of state are consumed, and they belong to the next window
            kept = self._raw
            self.read_until(-1)
            self._raw, self._ahead = kept, self._raw
        return self._decoder.next_t_ns if self._decoder.at_cut else None

    @property
    def raw(self) -> np.ndarray | None:
        return np.concatenate(self._raw) if self._raw else np.empty(0, np.uint8)

    def counters(self) -> dict[str, int]:
        named = {"events_outside": self._decoder.outside, "words_before_time": self._decoder.untimed}
        return {k: v for k, v in named.items() if v}

    @property
    def position(self) -> float:
        return min(1.0, self._file.tell() / self._size)

    def close(self) -> None:
        self._file.close()


def open_file(path: Path, backend: str = "auto") -> RawRecording:
    """Open a RAW file. Raises RecordingError."""
    return RawRecording(path, backend)


def _encoding(header: dict[str, str]) -> str:
    """`evt3`, ... from `format EVT3;...` or `evt 3.0`; empty where the header does not say."""
    name = header.get("format", "").partition(";")[0].strip().lower().replace(".", "")
    return name or _EVT.get(header.get("evt", ""), "evt" + header["evt"] if header.get("evt") else "")


def _geometry(header: dict[str, str], warnings: list[str]) -> tuple[int, int]:
    """Width and height from `geometry 640x480` or `format ...;height=480;width=640`; 0, 0 where there is none."""
    found = re.fullmatch(r"(\d{1,9})x(\d{1,9})", header.get("geometry", ""))
    width, height = (int(found[1]), int(found[2])) if found else (0, 0)
    if not found:
        parts = dict(re.findall(r";(width|height)=(\d{1,9})(?=;|$)", header.get("format", "")))
        if len(parts) == 2:
            width, height = int(parts["width"]), int(parts["height"])
    if width > 2048 or height > 2048 or (found and not width * height):
        warnings.append(f"the header's geometry {width}x{height} is not possible (1 to 2048) and was not used")
        return 0, 0
    return (width, height) if width and height else (0, 0)


def guess_encoding(data: bytes) -> str:
    """`evt2` or `evt3` by which word types are there and whether the time runs forward; empty when neither fits."""
    best, result = 0.9, ""
    for encoding, (legal, bits) in _LEGAL.items():
        word = make_decoder(encoding).word
        words = np.frombuffer(data, word, len(data) // word.itemsize)
        kind = words >> bits
        highs = (words[kind == 8] & (1 << bits) - 1).astype(np.int64)
        if len(highs) < 2:
            continue
        step = np.diff(highs)
        forward = np.count_nonzero((step >= 0) & (step < 1 << bits - 2) | (step < -(1 << bits - 1))) / len(step)
        score = min(np.isin(kind, legal).mean(), forward)
        if score > best:
            best, result = score, encoding
    return result


class RawWriter(Writer):
    """Writes RAW with a header that openeb and the other readers know."""

    def __init__(self, path: str | os.PathLike[str], width: int, height: int, encoder: Encoder) -> None:
        super().__init__(path)
        self._encoder = encoder
        name = encoder.encoding.upper()
        self._file = self.partial.open("wb")
        self._file.write(
            f"% evt {name[3]}.0\n% format {name};height={height};width={width}\n"
            f"% geometry {width}x{height}\n% integrator_name EVIS\n% end\n".encode()
        )

    def write(self, events: Events) -> None:
        self._file.write(self._encoder.encode(events))

    def _finish(self) -> None:
        self._file.close()

    def discard(self) -> None:
        self._file.close()
        super().discard()


def create(path: str | os.PathLike[str], width: int, height: int, encoding: str = "") -> RawWriter:
    """A RAW file of the given encoding (evt3 unless given). Raises RecordingError."""
    encoding = encoding or "evt3"
    if encoding not in CODECS:
        raise RecordingError(f"{path}: cannot write the encoding '{encoding}'; known are {', '.join(CODECS)}")
    if not (0 < width <= 2048 and 0 < height <= 2048):
        raise RecordingError(f"{path}: RAW holds sensors of 1 to 2048 pixels a side, not {width}x{height}")
    return RawWriter(path, width, height, importlib.import_module(CODECS[encoding]).Encoder())
