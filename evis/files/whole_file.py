"""Writes files that appear under their name only when they are complete."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from evis.files.named_pipe import with_reader


def written_at(path: Path) -> Path:
    """Returns where a file of this name is written: of a symbolic link, what it leads to, so that the link stays."""
    return Path(os.path.realpath(path)) if path.is_symlink() else path


def missing_folder(out: str | os.PathLike[str]) -> str:
    """Says that the folder of a file to write is not there, and what to do; "" where it is."""
    folder = written_at(Path(out)).absolute().parent
    if folder.is_dir():
        return ""
    if folder.exists():
        return f"{out}: {folder} is a file, and no folder that could hold it; name another one"
    return f"{out}: the folder {folder} does not exist; make it first"


@contextlib.contextmanager
def whole_file(out: str | os.PathLike[str]) -> Iterator[Path]:
    """Gives a path to write to, beside `out` and with its ending, that becomes `out` when the block ends well.

    After an error nothing is left of it, and an older `out` is as it was. What is no regular file (a pipe, /dev/null)
    is written in place, a pipe as soon as it has a reader. Raises OSError that names `out` where the system refuses,
    for a full disk too.
    """
    out = Path(out)
    place = written_at(out)
    if place.is_dir():
        raise IsADirectoryError(f"{out} is a folder; name a file to write")
    in_place = place.exists() and not place.is_file()
    partial = place if in_place else place.with_name(f".{place.stem[:100]}.{os.getpid()}.part{place.suffix}")
    try:
        with with_reader(place):
            yield partial
        if not in_place:
            partial.replace(place)
    except OSError as error:
        if error.errno is None or (error.filename is not None and os.fspath(error.filename) != str(partial)):
            raise  # it has its own text, or is about another file
        raise OSError(f"{out}: writing failed: {error.strerror}; nothing is left of it") from None
    finally:
        if not in_place:
            with contextlib.suppress(OSError):
                partial.unlink(missing_ok=True)
