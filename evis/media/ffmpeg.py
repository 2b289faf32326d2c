"""Names files as FFmpeg has to be told of them."""

from __future__ import annotations

import os


def address(path: str | os.PathLike[str]) -> str:
    """Returns the address of a file: FFmpeg takes what stands before a colon for a protocol, as of 12:30.mp4, and not
    where a slash comes first."""
    name = os.fspath(path)
    return f"./{name}" if ":" in name and not os.path.isabs(name) else name
