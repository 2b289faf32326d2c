"""Launches a kernel on a CPU again and again: to pack its arguments anew takes longer than small calls do."""

from __future__ import annotations

import os
import threading
from collections.abc import Sequence
from typing import Any

import warp as wp

from evis.warp_start import start_warp

start_warp()

_recording = threading.Lock()
"""Held while a launch is recorded, which loads the kernel's module where nobody has launched it yet: two threads at
once would load it twice, and what one of them has recorded would lead into the module that is unloaded again."""

# A process that is forked meanwhile would have it held for ever, by a thread that it does not have.
os.register_at_fork(before=_recording.acquire, after_in_parent=_recording.release, after_in_child=_recording.release)


class RepeatedLaunch:
    """Launches one kernel, whose first parameter is the number of its first thread, with the same arrays each time."""

    def __init__(self, kernel: wp.Kernel, given: Sequence[Any]) -> None:
        """Takes a kernel and what does not change from launch to launch. given: arguments after the first, as
        `wp.launch` takes them, which are held."""
        self._kernel, self._given = kernel, list(given)
        self._kept: tuple[int, wp.Launch] | None = None
        """The last whole launch, and its number of threads."""

    def whole(self, count: int) -> None:
        """Runs all `count` threads of the kernel, in one thread of the caller's at a time."""
        if self._kept is None or self._kept[0] != count:
            given = [0, *self._given]
            with _recording:
                self._kept = count, wp.launch(self._kernel, count, given, device="cpu", record_cmd=True)
        self._kept[1].launch()

    def part(self, start: int, count: int) -> None:
        """Runs `count` threads of the kernel from `start` on, beside other parts in other threads of the caller's."""
        # A part takes longer than to pack its arguments.
        wp.launch(self._kernel, count, [start, *self._given], device="cpu")
