"""Shows on a terminal what `interpolator:=auto` on the command line measures."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from evis.console.printable import printable


def warn(line: str) -> None:
    """Says on stderr what went wrong beside the choice."""
    print(f"interpolator auto: {printable(line)}", file=sys.stderr)


@contextmanager
def measuring_shown() -> Iterator[Callable[[str], None]]:
    """Shows on a terminal what is being measured, and for how long, in a line that is gone afterwards."""
    shown, began = sys.stderr.isatty(), time.monotonic()

    def say(line: str) -> None:
        if shown:
            spent = f"{time.monotonic() - began:.0f} s"
            print(
                f"\r\033[Kinterpolator auto, measuring, {spent}: {printable(line)}", end="", file=sys.stderr, flush=True
            )

    try:
        yield say
    finally:
        if shown:
            print("\r\033[K", end="", file=sys.stderr, flush=True)
