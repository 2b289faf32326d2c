"""Chooses how many keyframes, or gaps between them, are computed at once where nobody waits for a single one."""

from __future__ import annotations

from typing import Any

from evis.gpu.devices import device_named

MOST = 16
"""Most keyframes at once: beyond, more of them save next to no time."""
PIXELS = 1 << 25
"""Most pixels of frames that are made at once: so many keep any GPU busy."""
BYTES = 120
"""Device memory per pixel of a frame, of all nodes [bytes]."""
SHARE = 4
"""Of the device's memory, at most one in so many is taken without being asked for."""


def at_once(name: str, asked: int, device: str, envs: int, pixels: int, frames: int) -> int:
    """Computes how many keyframes a node makes at once.

    Args:
        name: the node's, for errors.
        asked: the parameter `batch`.
        device: where the kernels run.
        envs: parallel environments; more than one are a batch already, so that the result is 1.
        pixels: of a keyframe.
        frames: made of each keyframe.

    Raises:
        ValueError: for more than one with several environments, and where the device's memory does not hold as many.
    """
    where: Any = device_named(device)
    if asked > 1 and envs > 1:
        raise ValueError(f"{name}: batch:={asked} with envs:={envs}: environments are a batch already; leave one out")
    each = pixels * max(frames, 1)
    if asked > 1 and where.is_cuda and asked * each * BYTES > where.free_memory:
        need, free = (f"{size / 1e9:.3g} GB" for size in (asked * each * BYTES, where.free_memory))
        fits = max(where.free_memory // (each * BYTES), 1)
        raise ValueError(
            f"{name}: batch:={asked} takes about {need} on {where.alias}, of which {free} are free; batch:={fits} fits"
        )
    if asked or envs > 1 or where.is_cpu:
        return max(asked, 1)
    room = min(PIXELS, where.total_memory // (SHARE * BYTES)) // each
    # A power of two is the same for nodes whose pixel counts differ by a margin.
    return 1 << (max(min(room, MOST), 1).bit_length() - 1)
