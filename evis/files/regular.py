"""Tells what stands where a file is to be read: a pipe would be waited for without end, and a device has no end."""

from __future__ import annotations

import os
import stat

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a named pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


def other_than_file(path: str | os.PathLike[str]) -> str:
    """Names what a path leads to in place of a file (`a named pipe`); "" for a file, and where there is nothing."""
    try:
        return _KINDS.get(stat.S_IFMT(os.stat(path).st_mode), "")
    except (OSError, ValueError):
        return ""


class NotAFileError(OSError, ValueError):
    """Says in one line what a path leads to in place of a file."""


def check_file(path: str | os.PathLike[str]) -> None:
    """Raises NotAFileError where a path leads to something else than a file; whether anything is there is left to who
    opens it."""
    if what := other_than_file(path):
        raise NotAFileError(f"{os.fspath(path)}: it is {what}, and must be a file")
