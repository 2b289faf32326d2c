"""Records which files a scene was made of, and tells whether they are still as they were."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

Stamp = tuple[int, int, int] | None
"""Time of the last change [ns], bytes and number of a file; None where there is none."""
_noted: ContextVar[dict[Path, Stamp] | None] = ContextVar("files that are being noted", default=None)


def note(path: Path) -> Path:
    """Notes that a scene depends on a file that is about to be read, and returns it."""
    noted = _noted.get()
    if noted is not None and (real := path.absolute()) not in noted:
        noted[real] = stamp(real)
    return path


@contextmanager
def noting() -> Iterator[dict[Path, Stamp]]:
    """Collects the files that are read within the block, with how each was when it was first noted."""
    noted: dict[Path, Stamp] = {}
    token = _noted.set(noted)
    try:
        yield noted
    finally:
        _noted.reset(token)


def stamp(path: Path) -> Stamp:
    """Describes a file's present state."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino


def unchanged(files: dict[Path, Stamp]) -> bool:
    """Says whether all of these files are as they were."""
    return all(stamp(path) == before for path, before in files.items())
