"""Keeps output that a run could not write for its user, in a file that outlives the run."""

from __future__ import annotations

import contextlib
import os
import time
from pathlib import Path
from typing import TextIO

from evis.files.home import user_folder

MOST = 1 << 20
"""Longest log [characters]."""
KEPT = 20
"""Logs that are kept, the newest."""


def folder() -> Path:
    """Returns the folder of the logs: below XDG_STATE_HOME, or ~/.local/state. Raises OSError without a home."""
    return user_folder("XDG_STATE_HOME", ".local/state") / "evis" / "unsaid"


class Unsaid:
    """Logs to a file that is made when the first line could not be written.

    It never raises: nobody is left to be told.
    """

    def __init__(self, about: str) -> None:
        self._about = about
        self._file: TextIO | None = None
        self._reasons: dict[str, str] = {}
        self._lines = self._size = 0
        self._broken = False
        self.path: Path | None = None

    def add(self, text: str, reason: str) -> None:
        """Adds a text, and why it could not be written."""
        lines = [line for line in text.replace("\r", "\n").splitlines() if line.strip()]
        if self._broken or not lines:
            return
        now = time.strftime("%H:%M:%S")
        self._reasons.setdefault(reason, now)
        self._lines += len(lines)
        if self._size > MOST:
            return
        try:
            file = self._file or self._open()
            for line in lines:
                self._size += file.write(f"{now} {line}\n")
            file.flush()
        except (OSError, ValueError, RuntimeError):
            self._broken = True

    def close(self) -> None:
        """Writes at the end how much could not be written, and why."""
        if self._file is None or self._broken:
            return
        self._broken = True
        with contextlib.suppress(OSError, ValueError):
            why = "; ".join(f"{reason} (since {since})" for reason, since in self._reasons.items())
            short = ", of which the first are above" if self._size > MOST else ", all of them above"
            self._file.write(f"{self._lines} line(s) could not be said{short}. {why}\n")
            self._file.close()

    def _open(self) -> TextIO:
        place = folder()
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        for old in sorted(place.glob("*.log"))[: -(KEPT - 1)]:
            old.unlink(missing_ok=True)
        self.path = place / f"{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}.log"
        descriptor = os.open(self.path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o600)
        self._file = open(descriptor, "a", encoding="utf-8", errors="backslashreplace")
        self._file.write(f"{self._about}, process {os.getpid()}: what could not be said to the user\n")
        return self._file
