"""Finds the user's folders, also for a user whom the system does not know, as in a container run with a bare number."""

from __future__ import annotations

import os
from pathlib import Path


def user_folder(variable: str, below_home: str) -> Path:
    """Returns the folder that an XDG variable names, or the one below the user's home that stands for it.

    Raises OSError with the remedy where neither is known: there is no HOME, and the system has no such user.
    """
    if named := os.environ.get(variable):
        return Path(named)
    try:
        return Path.home() / below_home
    except RuntimeError:
        raise OSError(f"user {os.getuid()} has no home directory: set {variable} or HOME") from None
