"""Limits the events of one message: a gap in the stamps must not ask for all of the memory."""

from __future__ import annotations

import itertools

import numpy as np

from evis.gpu.room import free_host_memory

MOST_BACKGROUND = 1 << 27
"""Events of leak and noise that a message may have on average: while they are sorted, 4 GB."""
BYTES = 29
"""Memory that an event takes while it is sorted: its key twice, and its columns [bytes]."""
MANY = 1 << 24
"""Events for whose memory the system is asked, so that most calls need not."""
REMEDY = "put frames between the two, cut the sequence there"

MOST_NUMBERED = (1 << 31) - 1
"""Samples or events of a message, at most: kernels and sorting number them by int32."""


def check_events(count: int) -> None:
    """Raises ValueError where a message has more events than their sorting can number."""
    if count > MOST_NUMBERED:
        raise ValueError(f"{count} events in one message; raise the contrast threshold or keyframe_rate")


def check_host_memory(count: int) -> None:
    """Raises ValueError where the events of a message, while they are sorted, take more memory than the host has."""
    free = free_host_memory() if count >= MANY else None
    if free is not None and count * BYTES > free:
        raise ValueError(
            f"{count} events in one message take {count * BYTES / 1e9:.3g} GB while they are sorted, of which "
            f"{free / 1e9:.3g} are free; raise the contrast threshold or keyframe_rate"
        )


def longest_step(t_base: int, t: np.ndarray) -> str:
    """Returns where the longest step of a message is, in words. t_base: stamp before the frames at t [ns]."""
    stamps = [t_base, *t.tolist()]
    before, after = max(itertools.pairwise(stamps), key=lambda pair: pair[1] - pair[0])
    return f"from {before} ns to the frame at {after} ns"


def check_background_rate(per_second: float, pixels: str, t_base: int, t: np.ndarray) -> None:
    """Raises ValueError where leak and noise of so many events per second are too many for a message.

    pixels: how many there are, in words.
    """
    span_ns = int(t[-1]) - t_base
    if per_second * 1e-9 * span_ns >= MOST_BACKGROUND:
        raise ValueError(
            f"leak and noise make {per_second:.3g} events per second in {pixels} pixels, too many for a message of "
            f"{span_ns * 1e-9:.6g} s; its longest step is {longest_step(t_base, t)}: {REMEDY}, or lower their rates"
        )
