"""Reads Event Stream (.es) 2.x: a byte of time and polarity, then the address, with extra bytes where time goes on
alone."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from evis.events.arrays import Events
from evis.events.files.es.decoder import EsDecoder
from evis.events.files.es.layout import HEADER_BYTES, MAGIC, TIME_SHIFT, TYPES, VERSION
from evis.events.files.reading.block_recording import BlockRecording, take_size
from evis.events.files.reading.zero_tail import data_end
from evis.events.recording import OpenOptions, RecordingError, RecordingInfo

NAME = "Event Stream (.es)"

_BLOCK = 1 << 20


def matches(head: bytes, path: Path, name: str) -> bool:
    """Tells whether a file begins with the signature."""
    return head.startswith(MAGIC)


class EsRecording(BlockRecording):
    """Reads an .es file of type dvs or atis (whose exposure measurements are counted and left out)."""

    def __init__(self, path: Path, options: OpenOptions) -> None:
        size = path.stat().st_size
        with path.open("rb") as file:
            head = file.read(HEADER_BYTES)
        if len(head) < 16:
            raise RecordingError(f"{path}: cut inside its header of 16 bytes; there is no event")
        version = ".".join(map(str, head[12:15]))
        if head[12] != VERSION[0]:
            raise RecordingError(f"{path}: Event Stream of version {version}; known is version {VERSION[0]}")
        kind = TYPES.get(head[15], f"{head[15]}")
        if kind not in TIME_SHIFT:
            raise RecordingError(f"{path}: an Event Stream of type {kind}, which holds no polarity events")
        self.info = RecordingInfo(str(path), "es", kind, 0, 0, "header", size, header={"version": version})
        if len(head) < HEADER_BYTES:
            self.info.truncated = True
            self.info.warn("cut inside the header: there is no event")
        self._backend = options.backend
        self._file = path.open("rb")
        self._end = data_end(self._file.fileno(), HEADER_BYTES, self.info)
        try:
            width, height = int.from_bytes(head[16:18], "little"), int.from_bytes(head[18:20], "little")
            if not take_size(self.info, options):
                self.info.width, self.info.height = (width, height) if width and height else (0, 0)
                if not self.info.width:
                    self._size_from_events()
        except BaseException:
            self.close()
            raise
        super().__init__()

    def _load(self) -> Iterator[Events]:
        decoder = EsDecoder(self.info.encoding, self._backend, self.info.size_bytes)
        self._file.seek(HEADER_BYTES)
        while data := self._file.read(min(_BLOCK, max(self._end - self._file.tell(), 0))):
            events, exposures = decoder.decode(data)
            self.count("exposures_left_out", exposures)
            yield events
        while decoder.pending and self._file.tell() < self.info.size_bytes:  # the last event ends with zeros too
            yield decoder.decode(self._file.read(1))[0]
        if decoder.pending:
            self.info.truncated = True
            self.info.warn(f"cut inside an event: the last {decoder.pending} bytes hold none")

    @property
    def position(self) -> float:
        return min(1.0, self._file.tell() / max(self.info.size_bytes, 1))

    def close(self) -> None:
        self._file.close()


def open_file(path: Path, options: OpenOptions) -> EsRecording:
    """Opens an Event Stream. Raises RecordingError."""
    return EsRecording(path, options)
