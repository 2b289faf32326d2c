"""Handles a Ctrl-C of the program `evis` at a moment when nobody else does: exit status 130, and no traceback.

Imports come before any handler can: so this module is the first that is loaded, and needs nothing but what Python has
loaded already. Whoever imports evis as a library keeps Python's own ways.
"""

from __future__ import annotations

import _thread
import os
import sys
from types import TracebackType

STATUS = 130
"""Exit status after Ctrl-C: 128 and the number of SIGINT, as shells have it."""
IS_PROGRAM = os.path.basename(sys.argv[0] if sys.argv else "") in ("evis", "-m")
"""Python itself says -m while it imports the package of the module that it was told to run."""
_AGAIN_S = 0.01


def _unhandled(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    if not issubclass(kind, KeyboardInterrupt):
        sys.__excepthook__(kind, error, trace)
        return
    try:
        os.write(2, b"evis: interrupted\n")
    except OSError:
        pass
    os._exit(STATUS)


def _unraisable(ignored: sys.UnraisableHookArgs) -> None:
    """Ctrl-C within a finalizer would be shown and forgotten: it is sent again."""
    if not issubclass(ignored.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(ignored)
        return
    # From another thread: here it would be raised in this very function, and be ignored again.
    _thread.start_new_thread(_send_again, ())


def _send_again() -> None:
    import signal
    import time

    time.sleep(_AGAIN_S)
    os.kill(os.getpid(), signal.SIGINT)


def no_more() -> None:
    """Ignores Ctrl-C from here on: the exit status of the program is decided."""
    if IS_PROGRAM:
        import signal

        signal.signal(signal.SIGINT, signal.SIG_IGN)


if IS_PROGRAM:
    sys.excepthook = _unhandled
    sys.unraisablehook = _unraisable
