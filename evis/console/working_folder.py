"""Tells that the folder in which a program runs was removed, where the system says only that something is missing."""

from __future__ import annotations

import os

REMOVED = "the folder that this runs in was removed; `cd` to another one"


def is_removed() -> bool:
    """Tells whether the folder in which this process runs is there no more."""
    try:
        os.getcwd()
    except FileNotFoundError:
        return True
    return False


def is_of_removed(error: BaseException) -> bool:
    """Tells whether an error is that of this folder: of what else is missing the system gives the name."""
    return isinstance(error, FileNotFoundError) and error.filename is None and is_removed()
