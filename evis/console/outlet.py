"""Writes to standard output and error so that it cannot fail the command which writes.

A viewer dies, a terminal is closed, a disk is full: what cannot be said any more goes to a log if there is one, and the
command goes on with its work. What became of its output it is told at the end, for its exit status.
"""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Protocol, TextIO

_MOST = 1 << 16
"""Characters that wait for a flush, and that are held for a log to come."""


class Log(Protocol):
    """Defines where output goes that could not be written. `path`: where it lies, once there is something."""

    path: Path | None

    def add(self, text: str, reason: str) -> None:
        """Adds a text, and why it could not be written."""

    def close(self) -> None:
        """Ends the log: nothing more comes."""


class Outlet:
    """Wraps a text stream so that its writes never raise. `error`: why nothing can be said here any more.

    stream: None for one that was closed when the program started. `strict`: errors are raised as they come, for a
    command to which the end of its reader is the end of its work.
    """

    def __init__(self, stream: TextIO | None, name: str) -> None:
        self._closed_from_the_start = stream is None
        self._stream: TextIO = stream if stream is not None else open(os.devnull, "w")
        self._name = name
        self._waiting: list[str] = []
        self._size = 0
        self._lost = ""
        self._log: Log | None = None
        self.error: OSError | None = None
        self.strict = False

    @property
    def reason(self) -> str:
        """Describes `error` in words."""
        return f"{self._name}: {self.error.strerror or self.error}" if self.error else ""

    @property
    def kept_in(self) -> Path | None:
        """Returns the file that holds what could not be written here."""
        return self._log.path if self._log is not None else None

    def write(self, text: str) -> int:
        """Writes the text, or gives it to the log."""
        if self._closed_from_the_start and self.error is None and text:
            self.error = OSError(errno.EBADF, os.strerror(errno.EBADF))
        if self.error is not None:
            self._undelivered(text)
            return len(text)
        self._waiting.append(text)
        self._size += len(text)
        try:
            self._write(text)
            lines = getattr(self._stream, "line_buffering", False) and "\n" in text
        except (OSError, ValueError) as error:
            self._give_up(error)
            return len(text)
        if lines:
            self._delivered()
        elif self._size > _MOST:
            self.flush()
        return len(text)

    def _write(self, text: str) -> None:
        try:
            self._stream.write(text)
        except UnicodeEncodeError:
            code = self._stream.encoding or "ascii"
            self._stream.write(text.encode(code, "backslashreplace").decode(code))

    def writelines(self, lines: Any) -> None:
        """Writes one line after the other."""
        for line in lines:
            self.write(line)

    def flush(self) -> None:
        """Writes buffered text to the stream."""
        if self.error is None:
            try:
                self._stream.flush()
                self._delivered()
            except (OSError, ValueError) as error:
                self._give_up(error)

    def fall_back_on(self, log: Log) -> None:
        """Sends what cannot be written to a log, what could not be written before now too."""
        self._log = log
        if self._lost:
            log.add(self._lost, self.reason)
            self._lost = ""

    def close(self) -> None:
        """Flushes; the stream itself stays open, it is the process's."""
        self.flush()
        if self._log is not None:
            self._log.close()

    def _delivered(self) -> None:
        self._waiting.clear()
        self._size = 0

    def _give_up(self, error: Exception) -> None:
        self.error = error if isinstance(error, OSError) else OSError(errno.EBADF, str(error))
        text = "".join(self._waiting)
        self._delivered()
        with contextlib.suppress(OSError, ValueError):
            # What the stream still holds would be tried again when the program ends.
            null = os.open(os.devnull, os.O_WRONLY | os.O_CLOEXEC)
            os.dup2(null, self._stream.fileno())
            os.close(null)
            self._stream.flush()
        self._undelivered(text)
        if self.strict:
            raise self.error

    def _undelivered(self, text: str) -> None:
        if self._log is not None:
            self._log.add(text, self.reason)
        elif text:
            self._lost = (self._lost + text)[-_MOST:]

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextlib.contextmanager
def standard_streams() -> Iterator[tuple[Outlet, Outlet]]:
    """Makes sys.stdout and sys.stderr outlets for this block, and gives both. Within such a block: its own."""
    if isinstance(sys.stdout, Outlet) and isinstance(sys.stderr, Outlet):
        yield sys.stdout, sys.stderr
        return
    before: tuple[Any, Any] = sys.stdout, sys.stderr
    occupy()
    out, err = Outlet(before[0], "standard output"), Outlet(before[1], "standard error")
    sys.stdout, sys.stderr = out, err  # type: ignore[assignment]
    try:
        yield out, err
    finally:
        out.close()
        err.close()
        sys.stdout, sys.stderr = before


def occupy() -> None:
    """Opens /dev/null at each of the descriptors 0, 1, 2 that is closed: the next file opened would get it, and stray
    words.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)


def fall_back_on(log: Log) -> None:
    """Sends what the standard streams cannot write to a log, where they are outlets."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, Outlet):
            stream.fall_back_on(log)


@contextlib.contextmanager
def strict_output() -> Iterator[None]:
    """Raises in this block what cannot be written to standard output, as BrokenPipeError where its reader left."""
    stream: Any = sys.stdout
    if not isinstance(stream, Outlet):
        yield
        return
    if stream.error is not None:
        raise stream.error
    stream.strict = True
    try:
        yield
        stream.flush()
    finally:
        stream.strict = False


def delivered() -> bool:
    """Says whether all that was written to standard output so far has left this process."""
    sys.stdout.flush()
    return getattr(sys.stdout, "error", None) is None
