"""Writes objects of a JSON list that is longer than memory."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import IO, Any


class Lines:
    """Keeps objects of JSON in a file of their own, so that they need not wait in memory."""

    def __init__(self, path: Path) -> None:
        self._path, self._file, self.count = path, path.open("w"), 0

    def add(self, thing: dict[str, Any]) -> None:
        """Writes one more object, on a line of its own."""
        self._file.write((",\n" if self.count else "\n") + json.dumps(thing))
        self.count += 1

    def pour(self, out: IO[str]) -> None:
        """Copies all objects to `out`, and removes the file that held them."""
        self._file.close()
        with self._path.open() as file:
            shutil.copyfileobj(file, out)
        self._path.unlink()
