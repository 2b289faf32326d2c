"""Files compressed as a whole with Zstandard, as rosbag2 does (`bag_0.db3.zstd`): unpacked into a temporary file."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from evis.streams.events import Events
from evis.streams.recording import OpenOptions, Recording, RecordingError, open_recording

NAME = "any of these in Zstandard"

MAGIC = b"\x28\xb5\x2f\xfd"
_STEP = 1 << 20


def matches(head: bytes, path: Path) -> bool:
    """The first bytes of a Zstandard frame."""
    return head.startswith(MAGIC)


class ZstdRecording(Recording):
    """What is in the compressed file, read from its unpacked copy; the copy goes away with `close`."""

    def __init__(self, path: Path, options: OpenOptions) -> None:
        # the formats that go by name look at what is left of it
        self._folder = tempfile.TemporaryDirectory(prefix="evis-")
        try:
            copy = Path(self._folder.name) / (path.stem if path.suffix in (".zst", ".zstd") else path.name)
            whole = _unpack(path, copy)
            if not copy.stat().st_size:
                raise RecordingError(f"{path}: its compressed data are damaged or cut before anything can be unpacked")
            try:
                self._inner = open_recording(copy, options.backend, size=options.size, topic=options.topic)
            except RecordingError as error:
                raise RecordingError(str(error).replace(str(copy), str(path))) from None
        except BaseException:
            self._folder.cleanup()
            raise
        inner = self._inner.info
        self.info = replace(inner, path=str(path), size_bytes=path.stat().st_size, warnings=inner.warnings)
        if not whole:
            self.info.truncated = True
            self.info.warn("its compressed data end early")

    def blocks(self) -> Iterator[Events]:
        for events in self._inner.blocks():
            self._tell()
            yield events
        self._tell()

    def _tell(self) -> None:
        self.info.truncated |= self._inner.info.truncated

    def read_until(self, t_ns: int) -> Events:
        events = self._inner.read_until(t_ns)
        self._tell()
        return events

    def seek(self, t_ns: int) -> None:
        self._inner.seek(t_ns)

    @property
    def next_t_ns(self) -> int | None:
        return self._inner.next_t_ns

    @property
    def raw(self) -> np.ndarray | None:
        return self._inner.raw

    def counters(self) -> dict[str, int]:
        return self._inner.counters()

    @property
    def position(self) -> float:
        return self._inner.position

    def close(self) -> None:
        self._inner.close()
        self._folder.cleanup()


def _unpack(path: Path, copy: Path) -> bool:
    """Unpack, as far as the file goes: False where it ends early or is damaged."""
    import zstandard

    unpacker, size = zstandard.ZstdDecompressor(max_window_size=1 << 27), 0
    try:
        with path.open("rb") as file, copy.open("wb") as out:
            known = zstandard.frame_content_size(file.read(64))
            file.seek(0)
            for part in unpacker.read_to_iter(file, write_size=_STEP):
                out.write(part)
                size += len(part)
    except zstandard.ZstdError:
        return False
    except OSError as error:
        raise RecordingError(f"{path}: cannot be unpacked into {copy.parent}: {error.strerror}") from None
    return known < 0 or known == size


def open_file(path: Path, options: OpenOptions) -> ZstdRecording:
    """Open what is in a compressed file. Raises RecordingError."""
    return ZstdRecording(path, options)
