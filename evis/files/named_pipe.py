"""Writes to a named pipe, which waits for its reader: it says so after a moment, and Ctrl-C ends it."""

from __future__ import annotations

import contextlib
import errno
import os
import signal
import stat
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

MOMENT_S = 1.0
"""How long the wait goes on without a word [s]."""
_TURN_S = 0.05


@contextlib.contextmanager
def with_reader(path: str | os.PathLike[str], say: Callable[[str], None] | None = None) -> Iterator[None]:
    """Waits until a named pipe has a reader, and holds it open for this block; does nothing for what is no pipe.

    An open for writing within the block returns at once. say: takes the line about the wait (stderr).
    """
    descriptor = _opened(Path(path), say or _tell) if _is_pipe(path) else -1
    try:
        yield
    finally:
        if descriptor >= 0:
            os.close(descriptor)


def _is_pipe(path: str | os.PathLike[str]) -> bool:
    try:
        return stat.S_ISFIFO(os.stat(path).st_mode)
    except OSError:
        return False


def _opened(path: Path, say: Callable[[str], None]) -> int:
    """A descriptor, as soon as somebody reads. os.open without O_NONBLOCK would sleep in the kernel."""
    told = time.monotonic() + MOMENT_S
    with _interruptible():
        while True:
            try:
                return os.open(path, os.O_WRONLY | os.O_NONBLOCK | os.O_CLOEXEC)
            except OSError as error:
                if error.errno != errno.ENXIO:
                    raise
            if time.monotonic() > told:
                told = float("inf")
                say(f"{path} is a named pipe that nobody reads yet; waiting for a reader")
            time.sleep(_TURN_S)


@contextlib.contextmanager
def _interruptible() -> Iterator[None]:
    """Ctrl-C ends the wait at once, also where it is otherwise taken to mean `after this block`."""
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield
        return
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _tell(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
