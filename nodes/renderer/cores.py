"""Counts the CPU threads that share the pixels of images. Loads no kernels."""

from __future__ import annotations

import os

MOST_THREADS = 8
"""Most threads: beyond, work that one thread does alone takes most of the time."""
PIXELS_A_THREAD = 1 << 15
"""Least pixels that are worth the start of one more thread."""


def threads_for(asked: int, pixels: int) -> int:
    """Gives how many CPU threads share the pixels of images.

    asked: by the user; 0 = one per core that the process may use, within the limits above. pixels: of all environments.
    """
    return asked or max(1, min(MOST_THREADS, len(os.sched_getaffinity(0)), pixels // PIXELS_A_THREAD))
