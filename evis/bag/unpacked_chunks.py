"""Limits how many chunks of a bag are unpacked at once, while their messages wait for earlier ones in later chunks."""

from __future__ import annotations

import weakref
from pathlib import Path

from evis.bag.mcap.scan import TooLargeError
from evis.files.allowance import Allowance, AllowanceError


class ChunkHold:
    """Stands for the unpacked bytes of a chunk: who keeps a part of them keeps this too."""


class UnpackedLimit:
    """Limits the bytes of chunks that are unpacked at the same time, each of which may be unpacked alone.

    path, size: of the bag [bytes].
    """

    def __init__(self, path: Path, size: int) -> None:
        self._path = path
        self._allowance = Allowance(size)

    def hold(self, size: int) -> ChunkHold:
        """Counts a chunk of `size` bytes until the last reference to the result goes. Raises TooLargeError."""
        try:
            self._allowance.take(size)
        except AllowanceError as error:
            raise TooLargeError(f"{self._path}: its chunks overlap in time and are held at once: {error}") from None
        held = ChunkHold()
        weakref.finalize(held, self._free, size).atexit = False
        return held

    def _free(self, size: int) -> None:
        self._allowance.taken -= size
