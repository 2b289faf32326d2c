"""Reads events as text in a zip archive, as E2VID has them. Archives of arrays are `npz`."""

from __future__ import annotations

from pathlib import Path

from evis.events.files.text.reader import TextRecording, is_text_archive
from evis.events.recording import OpenOptions
from evis.files.magic import ZIP

NAME = "text in a zip archive"


def matches(head: bytes, path: Path, name: str) -> bool:
    """Tells whether a file is a zip archive with a text file in it."""
    return head.startswith(ZIP) and is_text_archive(path)


def open_file(path: Path, options: OpenOptions) -> TextRecording:
    """Opens the text file of an archive. Raises RecordingError."""
    return TextRecording(path, options)
