"""No orphans: a child dies with its launcher, whatever kind of death that is."""

from __future__ import annotations

import ctypes
import os
import signal

PARENT_VARIABLE = "EVIS_PARENT_PID"
"""Environment variable by which the supervisor tells a child who its launcher is."""
_PR_SET_PDEATHSIG = 1


def die_with_parent(parent_pid: int | None = None) -> None:
    """Ask the kernel to kill this process when its launcher dies; exit at once if the launcher is dead already.

    parent_pid: the launcher; from EVIS_PARENT_PID when not given, and nothing happens when that is not set either (a
    node run by hand has no launcher). Only Linux has this; elsewhere the supervisor's own clean-up is all there is.
    """
    if parent_pid is None:
        text = os.environ.get(PARENT_VARIABLE, "")
        if not text.isdigit():
            return
        parent_pid = int(text)
    try:
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    except (OSError, AttributeError):
        return
    # The launcher may have died between fork and prctl; the signal is then never sent.
    if os.getppid() != parent_pid:
        os._exit(1)
