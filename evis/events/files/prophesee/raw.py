"""Reads and writes Prophesee RAW: lines `% key value`, then the words as they came over the wire."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from evis.events.arrays import Events
from evis.events.codecs.decoder import backend_for, decoder_for
from evis.events.codecs.encoder import Encoder, encoder_for
from evis.events.files.file_writer import FileWriter, check_size
from evis.events.files.prophesee.raw_header import (
    KEYS,
    SYSTEMS,
    encoding_of,
    family_of,
    geometry_of,
    read_header,
    value_in_format,
)
from evis.events.files.reading.block_recording import take_size
from evis.events.files.reading.zero_tail import data_end
from evis.events.recording import OpenOptions, Recording, RecordingError, RecordingInfo

NAME = "Prophesee RAW (EVT2, EVT2.1, EVT3, EVT4)"

# of encodings that can be told without a header: legal word types, bits of TIME_HIGH's value in them, and by how much
# the types are shifted, in words of the dtype
_LEGAL = {
    "evt3": ("<u2", (0, 2, 3, 4, 5, 6, 7, 8, 10, 14, 15), 12, 0),
    "evt2": ("<u4", (0, 1, 8, 10, 14, 15), 28, 0),
    "evt21": ("<u8", (0, 1, 8, 10, 14, 15), 60, 32),
    "evt21_legacy": ("<u8", (0, 1, 8, 10, 14, 15), 28, 0),
}
_NAMES = {"evt2": "2.0", "evt21": "2.1", "evt21_legacy": "2.1", "evt3": "3.0", "evt4": "4.0"}
_COUNTERS = {"outside": "events_outside", "untimed": "words_before_time", "unknown": "words_unknown"}
_MARK_BYTES = 4 << 20
_GLANCE, _CHECKED = 1 << 17, 1 << 20
"""Bytes whose words are checked against the header's encoding, first and where they look wrong."""
_GUESSED = 1 << 16
"""Bytes by which words without a name are told apart."""
_MOST_LEGAL = 0.98
# numpy decodes the whole rest of a block for each cut in time: small blocks there
_BLOCK = {"numpy": 1 << 19, "warp": 1 << 22}
_WHOLE = 1 << 25
"""Bytes at a time of a file that is read as a whole: fewer blocks to join."""
_WINDOW_BLOCK = {"numpy": 1 << 15, "warp": 1 << 22}


def matches(head: bytes, path: Path, name: str) -> bool:
    """Tells whether a file has a header line (DAT files, which have one too, are asked first), or, named .raw, words
    alone.
    """
    if head.startswith(b"% ") or not name.lower().endswith(".raw"):
        return head.startswith(b"% ")
    with path.open("rb") as file:
        return bool(guess_encoding(file.read(_GUESSED)))


class _Mark(NamedTuple):
    """Holds the decoder's state at a word; t_ns: the latest time before it."""

    place: int
    t_ns: int
    state: np.ndarray


class RawRecording(Recording):
    """Reads a RAW file. Nothing but the current block is in memory."""

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
        if self._start and not KEYS & header.keys():
            raise RecordingError(f"{path}: damaged RAW header: none of {', '.join(sorted(KEYS))} in it")
        encoding = encoding_of(header)
        told = encoding
        if not encoding:
            encoding = guess_encoding(self._file.read(_GUESSED))
            self._file.seek(self._start)
        if encoding not in _NAMES:
            what = f"its encoding {encoding} is not supported" if encoding else "no encoding in the header or the data"
            if encoding in ("histo3d", "diff3d"):
                what = f"it holds images that the sensor made of its events ({encoding.upper()}), and no events"
            raise RecordingError(f"{path}: {what}; supported are {', '.join(_NAMES)}")
        self._size = size
        self._backend = backend_for(size) if options.backend == "auto" else options.backend
        self.info = RecordingInfo(str(path), "raw", encoding, 0, 0, "", size, header=header)
        self.info.serial = header.get("serial_number", "")
        self.info.sensor = header.get("sensor_name", header.get("sensor_generation", ""))
        if not self._start:
            self.info.warn(f"no header: the words read as {encoding}")
        self._decoder = decoder_for(encoding, 0, 0, self._backend)
        if encoding in _LEGAL and told and not (encoding == "evt21" and self._find_order(header)):
            self._check_encoding()
        self._end = size = data_end(self._file.fileno(), self._start, self.info, self._decoder.word.itemsize)
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
        self._decoder = decoder_for(self.info.encoding, self.info.width, self.info.height, self._backend)

    def _find_order(self, header: dict[str, str]) -> bool:
        """Finds whether the words of EVT2.1 are in legacy order, where the header does not say."""
        if "endianness" in header or value_in_format(header, "endianness"):
            return False
        data = self._file.read(_GLANCE)
        self._file.seek(self._start)
        if min(fit(data, "evt21")) >= _MOST_LEGAL or guess_encoding(data) != "evt21_legacy":
            return False
        self.info.encoding = "evt21_legacy"
        self._decoder = decoder_for("evt21_legacy", 0, 0, self._backend)
        self.info.warn("the header names no order of words; they read as evt21_legacy")
        return True

    def _check_encoding(self) -> None:
        """Warns where the first words are not of the encoding that the header names."""
        info = self.info
        data = self._file.read(_GLANCE)
        legal, forward = fit(data, info.encoding)
        if legal < _MOST_LEGAL or forward < 0.5:
            data += self._file.read(_CHECKED - len(data))
            legal, forward = fit(data, info.encoding)
        self._file.seek(self._start)
        if legal >= _MOST_LEGAL and forward >= 0.5:
            return
        likely = guess_encoding(data)
        if legal >= _MOST_LEGAL and likely in ("", info.encoding):
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
        info.width, info.height = geometry_of(header, info.warnings)
        info.geometry_from = "header"
        if info.width:
            return
        system = SYSTEMS.get(int(header["system_id"]) if header.get("system_id", "").isdecimal() else -1)
        if system:
            name, info.width, info.height = system
            info.sensor = info.sensor or name
            info.geometry_from = "system_ID"
            return
        info.width, info.height = family_of(header)
        if info.width:
            info.geometry_from = "sensor"
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
            # room for what the file does not have would be cleared first
            data = self._file.read(min(size, max(self._end - self._file.tell(), 0)))
        except OSError as e:
            raise RecordingError(f"{self.info.path}: reading failed: {e.strerror}") from None
        if data:
            self._decoder.feed(data)
        return bool(data)

    def blocks(self) -> Iterator[Events]:
        return self._blocks(_BLOCK[self._backend])

    def read(self) -> Events:
        return Events.concatenate([Events.empty(), *self._blocks(_WHOLE)])

    def _blocks(self, size: int) -> Iterator[Events]:
        more = self._decoder.pending >= self._decoder.word.itemsize or self._feed(size)
        while more:
            events = self._decoder.decode()
            self._keep_mark(events)
            yield events
            more = self._feed(size)

    def _keep_mark(self, events: Events) -> None:
        """Keeps the decoder's state at some places, so that a later `seek` can start from there."""
        place = self._file.tell() - self._decoder.pending
        if len(events) and (not self._marks or place >= self._marks[-1].place + _MARK_BYTES):
            t_ns = int(events.t.max())
            if self._marks:
                t_ns = max(t_ns, self._marks[-1].t_ns)
            self._marks.append(_Mark(place, t_ns, self._decoder.state.copy()))

    def seek(self, t_ns: int) -> None:
        """Seeks from the nearest place kept so far, then word by word: the turns of the time counter must be
        counted."""
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
            self._keep_mark(events)
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
    """Opens a RAW file. Raises RecordingError."""
    return RawRecording(path, options)


def fit(data: bytes, encoding: str) -> tuple[float, float]:
    """Computes the share of the words that the encoding has, and the share of time steps that go forward; 1 without
    any."""
    word, legal, shift, low = _LEGAL[encoding]
    words = np.frombuffer(data, word, len(data) // np.dtype(word).itemsize)
    kind = words >> shift
    if shift + 4 < 8 * words.itemsize:
        kind &= 15
    known = np.isin(np.arange(16), legal)[kind]
    if word == "<u8":  # the 32 pixels of a word begin at a whole multiple of 32
        known &= (kind > 1) | (words >> low + 11 & 31 == 0)
    bits = shift - low
    highs = (words[kind == 8] >> low & (1 << bits) - 1).astype(np.int64)
    step = np.diff(highs)
    # the counter goes on, by little, or turns; a long pause is passed over its last value
    half = 1 << bits - 1
    forward = (step >= 0) & (step < half >> 1) | (step < -half) | (highs[1:] == 2 * half - 1)
    return float(known.mean()) if len(words) else 1.0, float(forward.mean()) if len(step) else 1.0


def guess_encoding(data: bytes) -> str:
    """Finds the encoding whose word types occur and whose time runs forward; empty when none fits."""
    best, result = 0.9, ""
    for encoding, (word, _, shift, _) in _LEGAL.items():
        words = np.frombuffer(data, word, len(data) // np.dtype(word).itemsize)
        if np.count_nonzero(words >> shift & 15 == 8) >= 2 and (score := min(fit(data, encoding))) > best:
            best, result = score, encoding
    return result


class RawWriter(FileWriter):
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


def create(path: str | os.PathLike[str], width: int, height: int, encoding: str = "") -> RawWriter:
    """Makes a writer of RAW in the given encoding (evt3 unless given). Raises RecordingError."""
    encoding = encoding or "evt3"
    if encoding not in _NAMES:
        raise RecordingError(f"{path}: cannot write the encoding '{encoding}'; known are {', '.join(_NAMES)}")
    check_size(path, "RAW", width, height, 2048)
    return RawWriter(path, width, height, encoder_for(encoding, width, height))
