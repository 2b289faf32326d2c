"""Tries a call in a process of its own, for libraries that can hang or crash on damaged files."""

from __future__ import annotations

import contextlib
import faulthandler
import os
import resource
import signal
import sys
import time
import warnings
from collections.abc import Callable

CPU_S = 5
"""Processor time after which a trial counts as hanging; what is tried takes a fraction of a second."""
_WALL_S = 120
_BUSY_S = 2.0
"""A trial that is not over after so long counts as hanging if it has used this much processor time."""
_KILLED_FOR_TIME = (signal.SIGXCPU, signal.SIGKILL)


def outcome_of(work: Callable[[], object], cpu_s: int = CPU_S) -> str:
    """Tells how `work` ends in a copy of this process: empty where it ends by itself, `hangs` or `crashes`.

    Exceptions are an end like any other, and nothing that `work` does is seen here. Where the system has no fork, or
    the copy waits for what its other threads hold (it has only this one), nothing is tried and the result is empty.
    """
    if not hasattr(os, "fork"):
        return ""
    sys.stdout.flush()
    sys.stderr.flush()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of forks beside threads, which the limits below answer
        child = os.fork()
    if child == 0:
        _run_in_copy(work, cpu_s)
    status, end, pause = _wait(child), time.monotonic() + _WALL_S, 0.0005
    while status is None and time.monotonic() < end:
        time.sleep(pause)
        pause = min(2 * pause, 0.02)
        status = _wait(child)
    if status is None:
        os.kill(child, signal.SIGKILL)
        _, _, used = os.wait4(child, 0)
        return "hangs" if used.ru_utime + used.ru_stime > _BUSY_S else ""
    if not os.WIFSIGNALED(status):
        return ""
    return "hangs" if os.WTERMSIG(status) in _KILLED_FOR_TIME else "crashes"


def _run_in_copy(work: Callable[[], object], cpu_s: int) -> None:
    """Runs the work in the forked copy; never returns."""

    try:
        signal.signal(signal.SIGXCPU, signal.SIG_DFL)
        resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, cpu_s + 1))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        faulthandler.disable()
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        with contextlib.suppress(BaseException):
            work()
    finally:
        os._exit(0)


def _wait(child: int) -> int | None:
    """Returns the status of a child that has ended; None while it runs."""
    try:
        done, status = os.waitpid(child, os.WNOHANG)
    except ChildProcessError:  # somebody else has asked for it
        return 0
    return status if done else None
