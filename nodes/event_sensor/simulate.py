"""The event sensor on frames from anywhere: a video, another simulator, a test signal."""

from __future__ import annotations

from typing import Any

import numpy as np

from nodes.event_sensor.sensor import EventSensor

CHUNK_BYTES = 8_000_000
"""Frames per call are chosen to stay below this, so that a long video needs little memory."""


def simulate_frames(luminance: np.ndarray, t: np.ndarray, **params: Any) -> dict[str, np.ndarray]:
    """Events of a sequence of frames of one camera.

    luminance: float [T, H, W], linear. t: int64 [T] ns, strictly ascending. params: those of EventSensor. Returns t
    (int64 ns), x, y (uint16), p (uint8, 1 = ON), sorted by t, y, x, and the whole numbers `nonfinite` and `clipped`
    (0-d int64). The first frame is the reference and fires nothing. Raises ValueError.
    """
    luminance, t = np.asarray(luminance), np.asarray(t)
    if luminance.ndim != 3 or t.shape != luminance.shape[:1] or luminance.size == 0:
        raise ValueError(f"frames must be luminance [T, H, W] and t [T], got {luminance.shape} and {t.shape}")
    if not np.issubdtype(t.dtype, np.integer):
        raise ValueError(f"t is {t.dtype}, must be whole nanoseconds (int64)")
    count, height, width = luminance.shape
    sensor = EventSensor(height, width, **params)
    step = max(1, min(32, CHUNK_BYTES // (4 * height * width)))
    packets = []
    for first in range(0, count, step):
        part = np.ascontiguousarray(luminance[first : first + step], dtype=np.float32)
        packets.append(sensor.process(part[None], t[first : first + step], np.zeros(1, np.int32)))
    events = {name: np.concatenate([getattr(packet, name) for packet in packets]) for name in ("t", "x", "y", "p")}
    return {**events, "nonfinite": np.array(sensor.nonfinite), "clipped": np.array(sensor.clipped)}
