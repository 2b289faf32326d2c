"""Shows on a terminal how far a file is read, or how many frames are done; in a pipe nothing."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from evis.events import Recording


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
