"""Prophesee RAW: lines `% key value`, then the words as they came over the wire."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from evis.streams.decoder import backend_for, decoder_for
from evis.streams.encoder import Encoder, encoder_for
from evis.streams.events import Events
from evis.streams.files.blocks import take_size
from evis.streams.recording import OpenOptions, Recording, RecordingError, RecordingInfo, Writer

NAME = "Prophesee RAW (EVT2, EVT2.1, EVT3)"

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
# legal word types, bits of TIME_HIGH's value in them, and by how much the types are shifted, in words of the dtype
_LEGAL = {
    "evt3": ("<u2", (0, 2, 3, 4, 5, 6, 7, 8, 10, 14, 15), 12, 0),
    "evt2": ("<u4", (0, 1, 8, 10, 14, 15), 28, 0),
    "evt21": ("<u8", (0, 1, 8, 10, 14, 15), 60, 32),
    "evt21_legacy": ("<u8", (0, 1, 8, 10, 14, 15), 28, 0),
}
_NAMES = {"evt2": "2.0", "evt21": "2.1", "evt21_legacy": "2.1", "evt3": "3.0"}
_COUNTERS = {"outside": "events_outside", "untimed": "words_before_time", "unknown": "words_unknown"}
_MARK_BYTES = 4 << 20
_CHECKED = 1 << 20
"""Bytes whose words are checked against the header's encoding."""
_MOST_LEGAL = 0.98
_MAX_HEADER = 1 << 20
_MAX_LINE = 4096
_PRINTABLE = re.compile(rb"[\t\x20-\x7e]*")
# numpy decodes the whole rest of a block for each cut in time: small blocks there
_BLOCK = {"numpy": 1 << 19, "warp": 1 << 22}
_WINDOW_BLOCK = {"numpy": 1 << 15, "warp": 1 << 22}


def matches(head: bytes, path: Path) -> bool:
    """A header line; DAT files, which have such too, come before."""
    return head.startswith(b"% ")


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


class _Mark(NamedTuple):
    """The decoder's state at a word; t_ns: the latest time before it."""

    place: int
    t_ns: int
    state: np.ndarray


class RawRecording(Recording):
    """A RAW file. Nothing but the current block is in memory."""

    def __init__(self, path: Path, options: OpenOptions) -> None:
        self._file = path.open("rb")
        try:
            self._open(path, options)
        except BaseException:
            self._file.close()
            raise

    def _open(self, path: Path, options: OpenOptions) -> None:
        header, self._start = read_header(self._file)
        size = os.fstat(self._file.fileno()).st_size
        if not _KEYS & header.keys():
            raise RecordingError(f"{path}: damaged RAW header: none of {', '.join(sorted(_KEYS))} in it")
        encoding = _encoding(header)
        told = encoding
        if not encoding:
            encoding = guess_encoding(self._file.read(1 << 16))
            self._file.seek(self._start)
        if encoding not in _NAMES:
            what = f"its encoding {encoding} is not supported" if encoding else "no encoding in the header or the data"
            raise RecordingError(f"{path}: {what}; supported are {', '.join(_NAMES)}")
        self._size = size
        self._backend = backend_for(size) if options.backend == "auto" else options.backend
        self.info = RecordingInfo(str(path), "raw", encoding, 0, 0, "", size, header=header)
        self.info.serial = header.get("serial_number", "")
        self.info.sensor = header.get("sensor_name", header.get("sensor_generation", ""))
        self._decoder = decoder_for(encoding, 0, 0, self._backend)
        if told:
            self._check_encoding()
        rest = (size - self._start) % self._decoder.word.itemsize
        if rest:
            self.info.truncated = True
            self.info.warnings.append(f"cut inside a word: the last {rest} bytes hold no event")
        if size == self._start:
            self.info.warnings.append("no data after the header")
        self._raw: list[np.ndarray] = []
        self._ahead: list[np.ndarray] = []
        self._marks: list[_Mark] = []
        self._set_geometry(header, options)
        self._decoder = decoder_for(encoding, self.info.width, self.info.height, self._backend)

    def _check_encoding(self) -> None:
        """Warn where the first words are not of the encoding that the header names."""
        info = self.info
        data = self._file.read(_CHECKED)
        self._file.seek(self._start)
        legal, forward = fit(data, info.encoding)
        likely = guess_encoding(data)
        if legal >= _MOST_LEGAL and (forward >= 0.5 or likely in ("", info.encoding)):
            return
        words = len(data) // self._decoder.word.itemsize
        unknown = round((1 - legal) * words)
        what = f"{unknown} of the first {words} words are unknown to {info.encoding}, which the header names"
        if legal >= _MOST_LEGAL:
            what = f"as {info.encoding}, which the header names, the time of the words leaps back and forth"
        if likely and likely != info.encoding:
            info.warn(f"{what}; they read as {likely}: the header may name the wrong encoding")
        else:
            info.warn(f"{what}, and they read as no other known encoding: the data are damaged or of another kind")

    def _set_geometry(self, header: dict[str, str], options: OpenOptions) -> None:
        info = self.info
        if take_size(info, options):
            return
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
            events = self._decoder.decode()
            self._mark(events)
            yield events
            more = self._feed(_BLOCK[self._backend])

    def _mark(self, events: Events) -> None:
        """Remember the decoder's state at some places, so that a later `seek` can start from there."""
        place = self._file.tell() - self._decoder.pending
        if len(events) and (not self._marks or place >= self._marks[-1].place + _MARK_BYTES):
            t_ns = int(events.t.max())
            if self._marks:
                t_ns = max(t_ns, self._marks[-1].t_ns)
            self._marks.append(_Mark(place, t_ns, self._decoder.state.copy()))

    def seek(self, t_ns: int) -> None:
        """By the places seen so far, then word by word: the turns of the time counter must be counted."""
        earlier = [m for m in self._marks if m.t_ns < t_ns]
        self._decoder.reset()
        self._raw, self._ahead = [], []
        if earlier:
            self._decoder.state[:] = earlier[-1].state
        self._file.seek(earlier[-1].place if earlier else self._start)
        while True:
            events = self._decoder.decode_until(t_ns - 1)
            if self._decoder.at_cut:
                return
            self._mark(events)
            if not self._feed(_WINDOW_BLOCK[self._backend]):
                return

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
        return {_COUNTERS.get(k, k): v for k, v in self._decoder.counts.items() if v}

    @property
    def position(self) -> float:
        return min(1.0, self._file.tell() / self._size)

    def close(self) -> None:
        self._file.close()


def open_file(path: Path, options: OpenOptions) -> RawRecording:
    """Open a RAW file. Raises RecordingError."""
    return RawRecording(path, options)


def _encoding(header: dict[str, str]) -> str:
    """`evt3`, ... from `format EVT3;...` or `evt 3.0`; empty where the header does not say."""
    name = header.get("format", "").partition(";")[0].strip().lower().replace(".", "")
    name = name or _EVT.get(header.get("evt", ""), "evt" + header["evt"] if header.get("evt") else "")
    order = header.get("endianness", "") or _value(header, "endianness")
    return "evt21_legacy" if name == "evt21" and order == "legacy" else name


def _value(header: dict[str, str], name: str) -> str:
    """What `format EVT21;endianness=legacy;...` says of one name."""
    return dict(re.findall(r";(\w+)=(\w+)", header.get("format", ""))).get(name, "")


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


def fit(data: bytes, encoding: str) -> tuple[float, float]:
    """Shares of the words that the encoding has, and of the steps of the time that go forward; 1 without any."""
    word, legal, shift, low = _LEGAL[encoding]
    words = np.frombuffer(data, word, len(data) // np.dtype(word).itemsize)
    kind = (words >> shift & 15).astype(np.uint8)
    known = np.isin(kind, legal)
    if word == "<u8":  # the 32 pixels of a word begin at a whole multiple of 32
        known &= (kind > 1) | (words >> low + 11 & 31 == 0)
    bits = shift - low
    highs = (words[kind == 8] >> low & (1 << bits) - 1).astype(np.int64)
    step = np.diff(highs)
    # the counter goes on, by little, or turns
    forward = (step >= 0) & (step < 1 << bits - 2) | (step < -(1 << bits - 1))
    return float(known.mean()) if len(words) else 1.0, float(forward.mean()) if len(step) else 1.0


def guess_encoding(data: bytes) -> str:
    """The encoding whose word types are there and whose time runs forward; empty when none fits."""
    best, result = 0.9, ""
    for encoding, (word, _, shift, _) in _LEGAL.items():
        words = np.frombuffer(data, word, len(data) // np.dtype(word).itemsize)
        if np.count_nonzero(words >> shift & 15 == 8) >= 2 and (score := min(fit(data, encoding))) > best:
            best, result = score, encoding
    return result


class RawWriter(Writer):
    """Writes RAW with a header that openeb and the other readers know."""

    keeps = frozenset({"triggers"})

    def __init__(self, path: str | os.PathLike[str], width: int, height: int, encoder: Encoder) -> None:
        super().__init__(path)
        self._encoder = encoder
        name, _, order = encoder.encoding.partition("_")
        lines = [f"evt {_NAMES[name]}", f"format {name.upper()};height={height};width={width}"]
        if name == "evt21":
            order = order or "little"
            lines = [lines[0], f"format EVT21;endianness={order};height={height};width={width}", f"endianness {order}"]
        lines += [f"geometry {width}x{height}", "integrator_name EVIS", "end"]
        self._file = self.partial.open("wb")
        self._file.write("".join(f"% {line}\n" for line in lines).encode())

    def write(self, events: Events) -> None:
        kept = Events(events.t, events.x, events.y, events.p, events.c, events.triggers)
        self._file.write(self._encoder.encode(kept))

    def _finish(self) -> None:
        self._file.close()

    def discard(self) -> None:
        self._file.close()
        super().discard()


def create(path: str | os.PathLike[str], width: int, height: int, encoding: str = "") -> RawWriter:
    """A RAW file of the given encoding (evt3 unless given). Raises RecordingError."""
    encoding = encoding or "evt3"
    if encoding not in _NAMES:
        raise RecordingError(f"{path}: cannot write the encoding '{encoding}'; known are {', '.join(_NAMES)}")
    if not (0 < width <= 2048 and 0 < height <= 2048):
        raise RecordingError(f"{path}: RAW holds sensors of 1 to 2048 pixels a side, not {width}x{height}")
    return RawWriter(path, width, height, encoder_for(encoding, width, height))
