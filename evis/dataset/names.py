"""Checks names of files that the files of a data set tell: of sequences, of cameras, of what a sequence is made of."""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import Any


def below(name: Any) -> str:
    """Returns a name that leads to something below the folder from which it counts.

    Raises ValueError for any other: a data set is somebody else's word, and may not name files outside of its folder.
    """
    if not isinstance(name, str) or not name or "\0" in name:
        raise ValueError(f"{name!r:.80} is no name of a file")
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts:
        raise ValueError(f"'{name:.80}' leads out of its folder")
    return name
