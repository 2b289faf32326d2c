"""Implements what writers of one open file share, and what all of them check before they open it."""

from __future__ import annotations

import os
from typing import Any

from evis.events.recording import RecordingError, Writer


class FileWriter(Writer):
    """Writes into one file, `_file`, which a subclass opens under the name `partial`."""

    _file: Any

    def _finish(self) -> None:
        self._file.close()

    def discard(self) -> None:
        """Closes the file and leaves nothing of it behind."""
        self._file.close()
        super().discard()


def refuse_encoding(path: str | os.PathLike[str], encoding: str, kind: str) -> None:
    """Raises RecordingError if an encoding is given for a format that has no choice of one. kind: the format."""
    if encoding:
        raise RecordingError(f"{path}: an encoding ('{encoding}') is for .raw files; leave it out for {kind}")


def check_size(path: str | os.PathLike[str], kind: str, width: int, height: int, most: int) -> None:
    """Raises RecordingError if a format cannot hold a sensor's size. kind: the format. most: its pixels a side."""
    if not (0 < width <= most and 0 < height <= most):
        raise RecordingError(f"{path}: {kind} holds sensors of 1 to {most} pixels a side, not {width}x{height}")
