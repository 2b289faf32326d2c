"""Keeps a simulation to one thread at a time."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from typing import Concatenate, ParamSpec, Protocol, TypeVar

from evis.simulation.errors import SimulationError

P = ParamSpec("P")
R = TypeVar("R")


class Held(Protocol):
    """Defines what has a lock, which the thread holds that is in a call of it."""

    _in_use: threading.RLock


H = TypeVar("H", bound=Held)


def one_at_a_time(method: Callable[Concatenate[H, P], R]) -> Callable[Concatenate[H, P], R]:
    """Makes a method raise SimulationError where another thread is in a call of its object; nothing has happened then.

    Two threads at once would take each other's messages and actions.
    """

    @functools.wraps(method)
    def called(held: H, *args: P.args, **kwargs: P.kwargs) -> R:
        if not held._in_use.acquire(blocking=False):
            raise SimulationError(
                "another thread is in a call of this simulation; hold a lock around the calls, or make one simulation "
                "for each thread"
            )
        try:
            return method(held, *args, **kwargs)
        finally:
            held._in_use.release()

    return called
