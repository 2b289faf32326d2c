"""Syncs a file that is being written to the disk once a second, in a thread of its own."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from pathlib import Path

from evis.files.folder_sync import sync_folder

SYNC_PERIOD_S = 1.0


class Syncer:
    """Calls fdatasync on a file in every period in which something was written, from a thread of its own.

    written: brings what waits in this process to the file and gives the file's size. failed: told once what the system
    refused, from the thread; nothing is synced after that. The file and its folder (the name is there) are synced
    before this returns: raises OSError where the system cannot.
    """

    def __init__(
        self, descriptor: int, path: Path, written: Callable[[], int], failed: Callable[[OSError], None]
    ) -> None:
        self.count = self.late = 0
        """Calls of fdatasync; and how many of them took longer than a period."""
        self.synced = 0
        """Bytes of the file that are on the disk."""
        self._descriptor, self._written, self._failed = descriptor, written, failed
        self._ending = threading.Event()
        self.sync()
        sync_folder(path.resolve().parent)
        self._thread = threading.Thread(target=self._run, name="bag-sync", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        due = time.monotonic() + SYNC_PERIOD_S
        while not self._ending.wait(max(0.0, due - time.monotonic())):
            due = max(due + SYNC_PERIOD_S, time.monotonic())
            try:
                self.sync()
            except OSError as error:
                self._failed(error)
                return

    def sync(self) -> None:
        """Syncs now if something was written since the last time. Raises OSError."""
        size = self._written()
        if size == self.synced:
            return
        began = time.monotonic()
        self.count += 1
        os.fdatasync(self._descriptor)
        self.synced = size
        self.late += time.monotonic() - began > SYNC_PERIOD_S

    def stop(self) -> None:
        """Ends the thread, after its present call."""
        self._ending.set()
        self._thread.join()
