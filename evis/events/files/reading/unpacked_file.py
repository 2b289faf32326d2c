"""Holds temporary files without a name, so that what is unpacked is gone however the process ends."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from evis.events.recording import RecordingError, reason
from evis.files.allowance import Allowance

RESERVE = 64 << 20
"""Space that is left free on the file system of the temporary folder [bytes]."""
_DESCRIPTORS = Path("/proc/self/fd")


class UnpackedFile:
    """Holds what `source` unpacks to, in a file without a name in the temporary folder.

    path: where this process and its forks read it, until `close`. Raises RecordingError that names `source`.
    """

    def __init__(self, source: Path, allowance: Allowance) -> None:
        self._source, self._allowance, self._folder = source, allowance, tempfile.gettempdir()
        try:
            self._file = _nameless(self._folder)
        except OSError as error:
            raise self._refusal(reason(error)) from None
        self.path = _DESCRIPTORS / str(self._file.fileno())
        self.size = 0

    def put(self, part: bytes) -> None:
        """Appends bytes. Raises RecordingError where they are more than allowed, or than there is room for."""
        self._allowance.take(len(part))
        try:
            room = os.fstatvfs(self._file.fileno())
            if room.f_bavail * room.f_frsize < len(part) + RESERVE:
                raise self._refusal(f"{room.f_bavail * room.f_frsize >> 20} MiB are left there, of which 64 stay free")
            self._file.write(part)
        except OSError as error:
            raise self._refusal(reason(error)) from None
        self.size += len(part)

    def _refusal(self, why: str) -> RecordingError:
        where = f"cannot be unpacked into {self._folder}"
        return RecordingError(f"{self._source}: {where}: {why}; make room, or name another folder with TMPDIR")

    def close(self) -> None:
        """Closes the file, which frees its space on the disk."""
        self._file.close()


def _nameless(folder: str) -> IO[bytes]:
    """Opens a file without a name that could still be given one; where the system has no such, one that loses
    its name."""
    try:
        descriptor = os.open(folder, os.O_TMPFILE | os.O_RDWR | os.O_CLOEXEC, 0o600)
    except OSError:
        return tempfile.TemporaryFile(dir=folder, buffering=0)
    return os.fdopen(descriptor, "w+b", buffering=0)


@contextmanager
def with_name(path: Path) -> Iterator[Path]:
    """Gives the file of `UnpackedFile.path` a name for as long as a library needs to open it; others have theirs."""
    if path.parent != _DESCRIPTORS:
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="evis-") as folder:
        link, descriptor = Path(folder) / "copy", os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
        try:
            # with a folder's descriptor Python follows the link of /proc, without one it does not
            os.link(path, link, src_dir_fd=descriptor, follow_symlinks=True)
        except OSError:
            shutil.copyfile(path, link)
        finally:
            os.close(descriptor)
        yield link
