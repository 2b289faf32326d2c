"""Shows on a terminal how far a file is read, or how many frames are done; in a pipe nothing."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from evis.events import Recording

_REDRAW_S = 0.1


@contextmanager
def percent(recording: Recording, text: str) -> Iterator[Callable[[], None]]:
    """Shows a progress bar over a file, on a terminal only; call what it gives after each block."""
    if not sys.stderr.isatty():
        yield lambda: None
        return
    from tqdm import tqdm

    with tqdm(total=100, desc=text, unit="%", leave=False, file=sys.stderr) as bar:
        yield lambda: bar.update(int(100 * recording.position) - bar.n) and None


@contextmanager
def counted(total: int | None, text: str) -> Iterator[Callable[[int], None]]:
    """Shows a progress bar over frames, on a terminal only; call what it gives with the number of new ones."""
    if not sys.stderr.isatty():
        yield lambda n: None
        return
    from tqdm import tqdm

    with tqdm(total=total, desc=text, unit=" frames", leave=False, file=sys.stderr) as bar:
        yield lambda n: bar.update(n) and None


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
