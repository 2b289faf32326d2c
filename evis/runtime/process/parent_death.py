"""Ends a child process when its launcher dies in any way, so that no orphan is left."""

from __future__ import annotations

import ctypes
import os
import signal

PARENT_VARIABLE = "EVIS_PARENT_PID"
"""Environment variable by which the supervisor tells a child who its launcher is."""
_PR_SET_PDEATHSIG = 1


def die_with_parent() -> None:
    """Asks the kernel to kill this process when its launcher dies; exits at once if the launcher is dead already.

    The launcher is the process in EVIS_PARENT_PID; nothing happens when that is not set (a node run by hand has none).
    Only Linux has this; elsewhere the supervisor's own clean-up is all there is.
    """
    launcher = os.environ.get(PARENT_VARIABLE, "")
    if not launcher.isdigit():
        return
    try:
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    except (OSError, AttributeError):
        return
    # The launcher may have died between fork and prctl; the signal is then never sent.
    if os.getppid() != int(launcher):
        os._exit(1)
