"""Shows how a run goes: a progress bar on a terminal, lines above it; a log takes what cannot be said."""

from __future__ import annotations

import sys
from typing import Any

from evis.console.outlet import fall_back_on
from evis.console.unsaid import Unsaid


class Progress:
    """Shows simulated time, of `duration_s` where that is known."""

    def __init__(self, duration_s: float | None) -> None:
        fall_back_on(Unsaid("a run of evis"))
        self._bar: Any = None
        self._first_ns: int | None = None
        if sys.stderr.isatty():
            from tqdm import tqdm

            form = (
                "{desc} {bar} {n:.2f}/{total:g} s [{elapsed}]{postfix}"
                if duration_s
                else "{desc} {n:.2f} s [{elapsed}]{postfix}"
            )
            self._bar = tqdm(total=duration_s, desc="starting", bar_format=form, leave=False)

    def tick(self, progress: dict[str, Any]) -> None:
        """Shows the numbers of the latest heartbeats."""
        if self._bar is None:
            return
        if not progress["running"]:
            self._bar.refresh()  # the seconds of the start go on
            return
        self._bar.set_description_str("running", refresh=False)
        stamp = progress["stamp_ns"]
        # A real camera's clock does not start at 0.
        if self._first_ns is None and stamp:
            self._first_ns = 0 if stamp < 60_000_000_000 else stamp
        seconds = (stamp - (self._first_ns or 0)) / 1e9
        self._bar.n = min(seconds, self._bar.total) if self._bar.total else seconds
        self._bar.set_postfix_str(f" {progress['events']:,} events", refresh=True)

    def say(self, line: str) -> None:
        """Prints one line for the user, above the bar."""
        if self._bar is not None:
            self._bar.write(line, file=sys.stderr)
        else:
            print(line, file=sys.stderr, flush=True)

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *error: object) -> None:
        if self._bar is not None:
            self._bar.close()
