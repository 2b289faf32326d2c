"""Chooses how many keyframes, or gaps between them, are computed at once where nobody waits for a single one."""

from __future__ import annotations

import math
from typing import Any

from evis.gpu.devices import device_named
from evis.gpu.room import free_memory

MOST = 32
"""Most keyframes at once: of a disk at 30x8 on an H200, which waits for its host, 16 and 32 run at 64 and 95 times real
time; what keeps the GPU busy runs as fast with 16."""
ROUNDS, FEW = 12, 8
"""On a GPU a run has so many batches at least, or they have no more keyframes than that: in the first one buffers grow
to what it makes, and the last one is filled up. tunnel_exit for 4 s ran at 24 times real time with 8 and 19 with 32.
Nor have they where the run is recorded, by threads that wait for the events of a batch and are then waited for: the
disk at 640x480 was recorded at 4.1 times real time with 8, 3.8 with 16 and 3.3 with 32."""
MOST_REFINED, MOST_REFINED_ON_CPU = 8, 4
"""Most gaps at once whose pixels are looked at between frames too: on a GPU the disk, where it has little to do, runs
1.5 times as fast with eight as with four, and 1.1 times as fast again with sixteen, which take twice the memory."""
PIXELS_REFINED, BYTES_REFINED = 5 << 26, 100
"""Most pixels at all instants of such gaps, and device memory for each [bytes]: with 0.3 ms of the drone, of which
finer tolerances take half."""
PIXELS = 1 << 27
"""Most pixels of frames that are made at once: so many keep any GPU busy."""
MOST_ON_CPU = 8
"""Most keyframes at once on a CPU: of fewer at the end of a run the last one is rendered as often as others lack."""
PIXELS_ON_CPU, PIXELS_REFINED_ON_CPU = 1 << 22, 1 << 23
"""Most pixels of frames there, and at all instants of gaps with samples between their frames: what the host does for a
call costs little beside more of them, which no longer stay in its caches."""
BYTES = 120
"""Device memory per pixel of a frame, of all nodes [bytes]."""
SHARE = 4
"""Of the device's memory, at most one in so many is taken without being asked for."""
LEAST_OF_PIXEL, LEAST_OF_FRAME = 80, 4
"""Memory that every run takes at least, in all nodes, for a pixel of a keyframe and for each of its frames [bytes]."""
LEAST_OF_RIGID = 250
"""Of a pixel where sub-frames are drawn; measured were 420 on a CPU and 800 on a GPU."""
LEAST_OF_REFINED = 700
"""Of a pixel that is looked at between sub-frames too; measured were 970 with 0.3 ms and 1380 with 0.1 ms."""


def keyframes_of(run_s: float | None, rate: float) -> float:
    """Computes how many keyframes a run takes at a rate [Hz]; infinitely many where its length [s] is not known."""
    return math.inf if run_s is None else run_s * rate


def at_once(
    name: str,
    asked: int,
    device: str,
    envs: int,
    pixels: int,
    frames: int,
    paths: bool = False,
    keyframes: float = math.inf,
    recorded: bool = False,
) -> int:
    """Computes how many keyframes a node makes at once.

    Args:
        name: the node's, for errors.
        asked: the parameter `batch`.
        device: where the kernels run.
        envs: parallel environments; more than one are a batch already, so that the result is 1.
        pixels: of a keyframe.
        frames: made of each keyframe.
        paths: whether light comes by these, beside which a CPU's time for anything else is nothing.
        keyframes: of the whole run.
        recorded: whether a recorder takes what comes of them.

    Raises:
        ValueError: for more than one with several environments, and where the device's memory does not hold as many.
    """
    where: Any = device_named(device)
    if asked > 1 and envs > 1:
        raise ValueError(f"{name}: batch:={asked} with envs:={envs}: environments are a batch already; leave one out")
    each = pixels * max(frames, 1)
    left = free_memory(where) if asked > 1 and where.is_cuda else None
    if left is not None and asked * each * BYTES > left:
        need, free = (f"{size / 1e9:.3g} GB" for size in (asked * each * BYTES, left))
        fits = max(left // (each * BYTES), 1)
        raise ValueError(
            f"{name}: batch:={asked} takes about {need} on {where.alias}, of which {free} are free; batch:={fits} fits"
        )
    if asked or envs > 1 or (where.is_cpu and paths):
        return max(asked, 1)
    most, room = MOST_ON_CPU, PIXELS_ON_CPU
    if where.is_cuda:
        most, room = MOST, min(PIXELS, where.total_memory // (SHARE * BYTES))
        most = FEW if recorded else min(most, max(round(min(keyframes, ROUNDS * most)) // ROUNDS, FEW))
    # The same for nodes whose pixel counts differ by a margin.
    return _power_of_two(min(room // each, most))


def refined_at_once(count: int, asked: int, device: str, pixels: int) -> int:
    """Computes how many gaps with samples between their frames are made at once.

    Args:
        count: as many keyframes are there at once.
        asked: the parameter `batch`.
        device: where the kernels run.
        pixels: of a keyframe, at all instants of a gap.
    """
    where: Any = device_named(device)
    most = min(count, MOST_REFINED_ON_CPU if where.is_cpu else MOST_REFINED)
    if where.is_cpu and asked:
        return most
    room = PIXELS_REFINED_ON_CPU
    if where.is_cuda:
        room = min(PIXELS_REFINED, where.total_memory // (SHARE * BYTES_REFINED))
    return min(most, _power_of_two(room // pixels))


def _power_of_two(most: int) -> int:
    """Gives the greatest power of two up to a number, 1 at least."""
    return 1 << (max(most, 1).bit_length() - 1)


def check_room(
    name: str,
    device: str,
    envs: int,
    width: int,
    height: int,
    frames: int,
    least: int = LEAST_OF_PIXEL,
    fineness: int = 1,
) -> None:
    """Raises ValueError, before anything is made, where so many environments, or samples of a pixel, take more memory
    than the device has left.

    Args:
        name: the node's, for errors.
        device: where the kernels run.
        envs: parallel environments.
        width, height: of a keyframe, with its margin and all samples.
        frames: made of each keyframe.
        least: bytes that a pixel of a keyframe takes, its frames aside.
        fineness: samples per pixel and axis, which a keyframe holds apart.
    """
    if envs == 1 and fineness == 1:
        return
    where: Any = device_named(device)
    each = width * height * (least + LEAST_OF_FRAME * frames)
    free = free_memory(where)
    if free is None or envs * each <= free:
        return
    need, left = (f"{size / 1e9:,.1f} GB" for size in (envs * each, free))
    most = free // each if envs > 1 else 0
    remedy = f"envs:={most} are the most that may fit" if most > 1 else "take a smaller image, or one environment"
    if envs == 1:
        fits = int(fineness * (free / each) ** 0.5)
        remedy = f"take a smaller image, or supersampling:={max(fits, 1)}"
    raise ValueError(
        f"{name}: envs:={envs} of {width}x{height} with {frames} frames a keyframe take {need} of memory at least on "
        f"{where.alias}, of which {left} are free; {remedy}"
    )
