"""Shows how far a data set is: sequences, rate and remaining time on a terminal; in a pipe failures and notes alone."""

from __future__ import annotations

import sys
from typing import Any

from evis.console.printable import printable


class SequenceProgress:
    """Shows a bar of sequences."""

    def __init__(self) -> None:
        self._bar: Any = None

    def tick(self, made: Any, wanted: int) -> None:
        """Shows what a run has done, `evis.dataset.making.make.MakingResult`, of how many sequences that are wanted."""
        if not sys.stderr.isatty():
            return
        if self._bar is None:
            from tqdm import tqdm

            form = "{desc} {bar} {n}/{total} [{elapsed}]{postfix}"
            self._bar = tqdm(total=wanted, desc="making", bar_format=form, leave=False)
        self._bar.n = min(made.there, wanted)
        self._bar.set_postfix_str(remaining(made, wanted), refresh=True)

    def say(self, line: str) -> None:
        """Prints one line, above the bar."""
        if self._bar is not None:
            self._bar.write(printable(line), file=sys.stderr)
        else:
            print(printable(line), file=sys.stderr, flush=True)

    def __enter__(self) -> SequenceProgress:
        return self

    def __exit__(self, *error: object) -> None:
        if self._bar is not None:
            self._bar.close()


def remaining(made: Any, wanted: int) -> str:
    """Tells rate, time that is left, and what failed; the sequences of earlier runs do not count for the rate."""
    if not made.made or not made.seconds:
        return " the first ones"
    rate = made.made / made.seconds
    left = max(0, wanted - made.there - len(made.failed)) / rate
    minutes, seconds = divmod(round(left), 60)
    hours, minutes = divmod(minutes, 60)
    failed = f", {len(made.failed)} failed" if made.failed else ""
    return f" {3600 * rate:,.0f}/h, {hours:d}:{minutes:02d}:{seconds:02d} left{failed}"
