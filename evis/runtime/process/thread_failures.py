"""Notes exceptions that threads of nodes do not catch: Python would print them and let the process run on."""

from __future__ import annotations

import threading
import traceback
from types import TracebackType

from evis.runtime.hosting.node_call import NodeFailed
from evis.runtime.node import Node


class ThreadFailures:
    """Keeps the first exception that ended a thread of a process; `check` raises it for its node."""

    def __init__(self, process: str) -> None:
        """Takes the process's name, which stands for a thread in which no method of a node was running."""
        self._process = process
        self._first: NodeFailed | None = None

    def note(self, args: threading.ExceptHookArgs) -> None:
        """Notes an exception that ended a thread; a `threading.excepthook`."""
        error = args.exc_value
        if error is None or isinstance(error, SystemExit):
            return  # a thread that ends itself, as Python has it
        if self._first is None:
            failure = NodeFailed(_node_of(error.__traceback__) or self._process, error)
            failure.__cause__ = error
            self._first = failure  # before the trace is printed, which takes a while: the process may be at its end
        traceback.print_exception(error)

    def check(self) -> None:
        """Raises NodeFailed if a thread has ended with an exception."""
        if self._first is not None:
            raise self._first


def _node_of(trace: TracebackType | None) -> str:
    """Names the node in whose method the exception was raised or passed by; "" for none."""
    while trace is not None:
        owner = trace.tb_frame.f_locals.get("self")
        if isinstance(owner, Node):
            return owner.name
        trace = trace.tb_next
    return ""
