"""Counts what a reader of a bag holds of chunks whose messages wait for earlier ones of later chunks."""

from __future__ import annotations

import weakref
from pathlib import Path

from evis.bag.mcap.scan import TooLargeError
from evis.files.allowance import Allowance, AllowanceError


class Held:
    """Stands for the unpacked bytes of a chunk: whoever keeps a part of them keeps this too."""


class Waiting:
    """Limits how much is unpacked at the same time, of chunks each of which may be unpacked alone.

    path, size: of the bag [bytes].
    """

    def __init__(self, path: Path, size: int) -> None:
        self._path = path
        self._allowance = Allowance(size)

    def hold(self, size: int) -> Held:
        """Counts a chunk of `size` bytes until the last reference to what is returned goes. Raises TooLargeError."""
        try:
            self._allowance.take(size)
        except AllowanceError as error:
            raise TooLargeError(f"{self._path}: its chunks overlap in time and are held at once: {error}") from None
        held = Held()
        weakref.finalize(held, self._free, size).atexit = False
        return held

    def _free(self, size: int) -> None:
        self._allowance.taken -= size
