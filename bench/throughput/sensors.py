"""Measures our event sensor beside those of others, on the same frames in the same run."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import warp as wp

from bench.event_sensor import disk
from bench.event_sensor.gpu import Loop
from bench.event_sensor.gpu_peers import THRESHOLD, Call, peers
from bench.event_sensor.signals import SECOND
from nodes.event_sensor.readout.device_events import CALLS
from nodes.event_sensor.sensor import EventSensor

PERIOD = SECOND // 1000
FRAMES = 200
CALL_SIZES = (1, 8, 50)
"""Frames of a call."""
ROUNDS = 5
CALLS_OF_ROUND = 24
"""At least, so that a round is long beside its beginning and its end."""


def rows(device: str, quick: bool) -> list[dict[str, Any]]:
    """Measures frames a second of each sensor, by the number of frames of a call; ours also over each of the others."""
    count = 50 if quick and device == "cpu" else FRAMES
    frames = disk.record((np.arange(count, dtype=np.int64) + 1) * PERIOD, soft=1.0).luminance
    at = {size: f"{size} a call" for size in CALL_SIZES}
    ours = {size: of_ours(frames, size, 1, device) for size in CALL_SIZES}
    several = {size: of_ours(frames, size, CALLS, device) for size in CALL_SIZES}
    found: list[dict[str, Any]] = [
        {"sensor": f"ours, {how}"} | {at[size]: round(rate) for size, rate in rates.items()}
        for how, rates in (("one call at a time", ours), (f"{CALLS} calls in flight", several))
    ]
    for name, call in peers(device):
        row: dict[str, Any] = {"sensor": name}
        if isinstance(call, str):
            row["not measured"] = call
        else:
            rates = {size: of_peer(call, frames, size, device) for size in CALL_SIZES}
            row |= {at[size]: round(rate) for size, rate in rates.items()}
            row |= {f"ours / it, {at[size]}": round(ours[size] / rate, 1) for size, rate in rates.items()}
        found.append(row)
    return found


def of_ours(frames: np.ndarray, size: int, calls: int, device: str) -> float:
    """Measures frames a second of our sensor, its events in order and on the device."""
    whole = range(0, len(frames) - size + 1, size)
    images: list[wp.array] = [wp.array(frames[i : i + size][None], dtype=wp.float32, device=device) for i in whole]
    height, width = frames.shape[1:]
    sensor = EventSensor(height, width, threshold=THRESHOLD, device=device)
    us, _ = Loop(sensor, images).timed(max(CALLS_OF_ROUND, len(images)), calls)
    return 1e6 * size / us


def of_peer(call: Call, frames: np.ndarray, size: int, device: str) -> float:
    """Measures frames a second of another sensor, its events on the device: the best of some rounds after one."""
    import torch

    wait = torch.cuda.synchronize if device.startswith("cuda") else lambda: None
    tensors = torch.from_numpy(frames).to(device)
    step = torch.arange(1, size + 1, dtype=torch.int64, device=device) * PERIOD
    parts, now, times = [tensors[i : i + size] for i in range(0, len(frames) - size + 1, size)], 0, []
    parts *= -(-CALLS_OF_ROUND // len(parts))
    for _ in range(1 + ROUNDS):
        wait()
        began = time.perf_counter()
        for part in parts:
            call(part, step + now)
            now += size * PERIOD
        wait()
        times.append(time.perf_counter() - began)
    return size * len(parts) / min(times[1:])
