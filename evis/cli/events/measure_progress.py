"""Shows the progress of `evis events measure` on a terminal: how far into the recording, and what the fit is at."""

from __future__ import annotations

import sys
import time
from typing import Any

_REDRAW_S = 0.1


class PassProgress:
    """Shows a bar that also moves while no events are read; nothing in a pipe."""

    def __init__(self, text: str) -> None:
        self._bar: Any = None
        self._drawn = 0.0
        if sys.stderr.isatty():
            from tqdm import tqdm

            form = "{desc} {percentage:3.0f}% {bar} [{elapsed}]{postfix}"
            self._bar = tqdm(total=100, desc=text, bar_format=form, leave=False, file=sys.stderr)

    def at(self, share: float) -> None:
        """Shows the share of the recording that has been read, 0 to 1."""
        if self._bar is not None:
            self._bar.n = int(100 * share)
            self.say("")

    def say(self, what: str) -> None:
        """Shows a text beside the bar; drawn ten times a second at most."""
        if self._bar is not None and time.monotonic() - self._drawn > _REDRAW_S:
            self._drawn = time.monotonic()
            self._bar.set_postfix_str(what, refresh=True)

    def __enter__(self) -> PassProgress:
        return self

    def __exit__(self, *error: object) -> None:
        if self._bar is not None:
            self._bar.close()
