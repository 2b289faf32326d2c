"""Tells the errors that readers raise on damaged files from a mistake of the program, and puts them on one line."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager

FAULTS: tuple[type[Exception], ...] = (
    OSError, EOFError, ValueError, ArithmeticError, MemoryError, NotImplementedError, struct.error, zlib.error,
)  # fmt: skip
"""Exceptions that a file's content causes: it ends early, says numbers that cannot be, or wants more than there is.
Lookups, wrong types, missing names and failed assertions are not among them: those are a reader's own mistakes."""
_LIBRARIES = ("zipfile", "tarfile", "_lzma", "sqlite3", "zstandard")
"""Modules with exceptions of their own for damaged data, which are not imported for their names alone."""


def is_fault(error: BaseException) -> bool:
    """Returns whether an exception in a reader is the fault of what it reads."""
    return isinstance(error, FAULTS) or type(error).__module__.partition(".")[0] in _LIBRARIES


def error_text(error: BaseException, most: int = 1000) -> str:
    """Gives what an error says on one line of at most `most` characters, the name of its type where it says nothing."""
    return (" ".join(str(error).split()) or type(error).__name__)[:most]


@contextmanager
def faults_as(kind: type[ValueError], name: str | os.PathLike[str]) -> Iterator[None]:
    """Turns the faults of a file into `kind`, whose text names the file; everything else passes as it is.

    The cause stays with the error, so that a traceback shows it.
    """
    try:
        yield
    except kind:
        raise
    except Exception as error:
        if not is_fault(error):
            raise
        text = error_text(error, 300)
        if isinstance(error, OSError) and error.errno:
            text = os.strerror(error.errno)
        if isinstance(error, MemoryError):
            text = f"there is not enough memory to read it ({text})"
        raise kind(text if os.fspath(name) in text else f"{os.fspath(name)}: {text}") from error
