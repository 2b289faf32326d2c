"""Handles a Ctrl-C or SIGTERM of the program `evis` at a moment when nobody else does: exit status 130 or 143, and no
traceback.

Imports come before any handler can: so this module is the first that is loaded, and needs nothing but what Python has
loaded already. Whoever imports evis as a library keeps Python's own ways.
"""

from __future__ import annotations

import _thread
import os
import sys
from types import FrameType, TracebackType

SIGINT = 2
"""Number of Ctrl-C's signal, which `signal` knows too, but that is not loaded yet."""
STATUS = 128
"""Exit status after a signal, with its number added, as shells have it."""
IS_PROGRAM = os.path.basename(sys.argv[0] if sys.argv else "") in ("evis", "-m")
"""Python itself says -m while it imports the package of the module that it was told to run."""
_AGAIN_S = 0.01
_ONCE_S = 0.005
"""What asks twice within this asks once: `timeout` sends SIGTERM to a program and then to its group [s]."""


def _unhandled(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    if not issubclass(kind, KeyboardInterrupt):
        sys.__excepthook__(kind, error, trace)
        return
    try:
        os.write(2, b"evis: interrupted\n")
    except OSError:
        pass
    os._exit(STATUS + _number(error))


def _number(error: BaseException | None) -> int:
    """The signal that a KeyboardInterrupt came of."""
    return error.args[0] if error is not None and error.args and isinstance(error.args[0], int) else SIGINT


def _unraisable(ignored: sys.UnraisableHookArgs) -> None:
    """Ctrl-C within a finalizer would be shown and forgotten: it is sent again."""
    if not issubclass(ignored.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(ignored)
        return
    # From another thread: here it would be raised in this very function, and be ignored again.
    _thread.start_new_thread(_send_again, (_number(ignored.exc_value),))


def _send_again(number: int) -> None:
    import time

    time.sleep(_AGAIN_S)
    os.kill(os.getpid(), number)


def begin() -> None:
    """Lets SIGTERM, as `timeout`, `docker stop` and batch systems send it, end the program in order, as Ctrl-C does.

    SIGCHLD is no longer ignored where who started the program had it so: the system would forget how its processes end.
    """
    if IS_PROGRAM:
        import signal
        import time

        asked_at = 0.0

        def ask(number: int, frame: FrameType | None) -> None:
            nonlocal asked_at
            before, asked_at = asked_at, time.monotonic()
            if asked_at - before > _ONCE_S:
                raise KeyboardInterrupt(number)

        signal.signal(signal.SIGTERM, ask)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)


def no_more() -> None:
    """Ignores Ctrl-C from here on: the exit status of the program is decided. SIGTERM ends it wherever it is."""
    if IS_PROGRAM:
        import signal

        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


if IS_PROGRAM:
    sys.excepthook = _unhandled
    sys.unraisablehook = _unraisable
