"""Tells what the format of a file cannot hold of events: times before its zero or finer than a us, colours."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from evis.events import Events


@contextmanager
def counted_from_zero(rebase: bool) -> Iterator[None]:
    """Tells what helps where times do not fit a format although --rebase was given. Raises RecordingError."""
    from evis.events.codecs.encoder import REBASE
    from evis.events.recording import RecordingError

    try:
        yield
    except ValueError as error:
        if not rebase or REBASE not in str(error):
            raise
        helps = "with --rebase too: sort the events by time, or write .npz"
        raise RecordingError(str(error).replace(REBASE, helps)) from None


def holds_whole_us(path: str) -> bool:
    """Says whether a file by this name is written in a format that rounds times to whole us."""
    from evis.events.recording import WHOLE_US

    return path.lower().endswith(WHOLE_US)


def rounded(events: Events) -> int:
    """Counts the events whose time such a format rounds."""
    return int((events.t % 1000 != 0).sum())


def colourless(events: Events, path: str) -> int:
    """Counts the events whose colour a file by this name cannot hold."""
    return len(events) if events.c is not None and not path.lower().endswith(".npz") else 0
