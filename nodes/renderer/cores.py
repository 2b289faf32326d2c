"""How many CPU threads share the pixels of images. Loads no kernels."""

from __future__ import annotations

import os

MOST_THREADS = 8
"""Beyond so many, what one thread does alone takes as long."""
PIXELS_A_THREAD = 1 << 15
"""Fewer are not worth the start of one more thread."""


def threads_for(asked: int, pixels: int) -> int:
    """Gives how many CPU threads share images of so many pixels in all environments.

    asked: by the user; 0 = one per core that the process may use, but no more than the pixels are worth.
    """
    return asked or max(1, min(MOST_THREADS, len(os.sched_getaffinity(0)), pixels // PIXELS_A_THREAD))
