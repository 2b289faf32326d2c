"""Finds the processes that give no sign of life, and ends them: a stuck one would be waited for without end."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterable

from evis.supervisor.child import Child

SILENCE_S = 8.0
"""A process that sends no heartbeat for so long is frozen [s]; a thread of its own sends one every 0.5 s."""
SUSPECT_S = 4.0
"""SILENCE_S while a process reports a lost neighbour: the bus gives a frozen peer up 5 s after its last answer [s]."""
STARTUP_SILENCE_S = 60.0
"""SILENCE_S before a process's first heartbeat: imports come first [s]."""


def end_if_frozen(child: Child) -> bool:
    """Ends a process that has been silent for longer than it may; says whether it was."""
    limit_s = SILENCE_S if child.stats or child.state != "starting" else STARTUP_SILENCE_S
    frozen = _silent_s(child) > limit_s
    if frozen:
        _end(child, limit_s)
    return frozen


def suspects(children: Iterable[Child]) -> list[Child]:
    """Finds the processes that have been silent for so long that a neighbour may have given them up."""
    return [c for c in children if c.stats and not c.ended and c.alive() and _silent_s(c) > SUSPECT_S]


def end_suspects(children: Iterable[Child]) -> None:
    """Ends the processes that a neighbour has missed: the cause is who is silent, not who says so before SILENCE_S is
    over."""
    for child in suspects(children):
        _end(child, _silent_s(child))


def _silent_s(child: Child) -> float:
    return time.monotonic() - child.heard_at


def _end(child: Child, silent_s: float) -> None:
    """Kills a process that gives no sign of life, which is then the failure."""
    text = f"gave no sign of life for {silent_s:.0f} s (stopped, or stuck in native code)"
    child.failure, child.state = (child.where or child.name, text), "failed"
    child.signal(signal.SIGKILL)
