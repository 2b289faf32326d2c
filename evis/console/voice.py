"""Lets a run talk to its user, and go on when nobody can be told any more."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from evis.console.unsaid import Unsaid


class Voice:
    """Calls `say` with each line for the user and `tick` with the progress; their errors end neither the run nor it.

    A line that could not be said goes to a log (evis/console/unsaid.py). A progress that failed is not tried again.
    """

    def __init__(self, say: Callable[[str], None] | None, tick: Callable[[dict[str, Any]], None] | None) -> None:
        self._say = say or (lambda line: print(line, file=sys.stderr, flush=True))
        self._tick = tick
        self._unsaid = Unsaid("a run of evis")

    def say(self, line: str) -> None:
        """Says one line to the user."""
        try:
            self._say(line)
        except (OSError, ValueError) as error:  # ValueError: the stream has been closed
            self._unsaid.add(line, str(error))

    def tick(self, progress: dict[str, Any]) -> None:
        """Shows the progress so far."""
        if self._tick is not None:
            try:
                self._tick(progress)
            except (OSError, ValueError) as error:
                self._tick = None
                self._unsaid.add("the progress is shown no more", str(error))

    def close(self) -> None:
        """Ends the log of what could not be said: the run is over."""
        self._unsaid.close()
