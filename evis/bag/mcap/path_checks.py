"""Finds out where a bag cannot be written before anything is opened; the planner imports it, so it loads no reader."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from evis.bag import BagError

OTHER_FORMATS = (
    ".bag", ".db3", ".raw", ".dat", ".es", ".aedat", ".aedat2", ".aedat4", ".h5", ".hdf5", ".npz", ".csv", ".txt",
    ".json", ".jsonl", ".yaml",
)  # fmt: skip
"""Endings that say of a file that it is something else."""


class BagNameError(BagError):
    """Says that no bag is written under such a name."""


def check_name(path: Path) -> None:
    """Raises BagNameError for a name that a bag should not have: that of another format, or - for standard output."""
    if str(path) == "-":
        raise BagNameError("cannot record to -: a bag does not go to standard output; name a file such as run.mcap")
    if path.suffix.lower() in OTHER_FORMATS:
        raise BagNameError(
            f"cannot record to {path}: what is written is MCAP, and {path.suffix} is the ending of another format; "
            f"name it {path.with_suffix('.mcap')} (`evis bag export` makes other formats of it)"
        )


def refusal(place: Path) -> str:
    """Words why nothing can be written at a folder or file, and what to do instead."""
    what = f"{'folder' if place.is_dir() else 'file'} {place}"
    with contextlib.suppress(OSError):
        if os.statvfs(place).f_flag & os.ST_RDONLY:
            return f"the file system of {what} is read-only; name a file on another one"
    return f"no permission to write in {what}; name a file in another folder"
