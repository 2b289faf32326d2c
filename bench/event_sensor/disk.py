"""Draws a high-dynamic-range test video: a spinning disk of patches before a drifting exponential ramp.

The patches have albedo 0.1 or 0.6 under an irradiance of 100, a fifth more on one side than in the middle, so that
every pixel returns to values of its own; radius 120 px, 50 rad/s. Behind them the radiance grows from 1e-2 to 1e3
across the picture and drifts at 100 px/s.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import warp as wp

from bench.event_sensor.disk_kernels import draw
from bench.event_sensor.signals import SECOND, Recording
from evis.events.measure.distance import EventStream

RINGS, SECTORS = 4, 16
TOLERANCE = 1e-6
"""Of a threshold: what a crossing may be missed by and still count, in the reference."""


def record(t: np.ndarray, soft: float, width: int = 640, height: int = 480, seed: int = 1) -> Recording:
    """Draws frames at the stamps t [ns]."""
    patches = np.where(np.random.default_rng(seed).random((RINGS, SECTORS)) < 0.5, 10.0, 60.0)
    luminance, slope = (np.empty((len(t), height, width), np.float32) for _ in range(2))
    inputs = [wp.array(t / SECOND, dtype=wp.float64, device="cpu"), wp.array(patches, device="cpu"), soft]
    outputs: list[wp.array] = [wp.array(a, copy=False, device="cpu") for a in (luminance, slope)]
    wp.launch(draw, luminance.shape, inputs, outputs, device="cpu")
    return Recording(luminance, slope, np.asarray(t, np.int64))


def reference_events(frames: Iterable[np.ndarray], t: np.ndarray, threshold: float) -> EventStream:
    """Computes the true events in float64: whole thresholds from the first frame on, times linear in ln I."""
    images = iter(frames)
    first = np.log(next(images).astype(np.float64))
    height, width = first.shape
    base, before = first.ravel(), first.ravel()
    level = np.zeros(base.size, np.int64)
    parts = []
    for k, image in enumerate(images, 1):
        now = np.log(image.astype(np.float64)).ravel()
        delta = (now - base) / threshold - level
        n = np.floor(np.abs(delta) + TOLERANCE).astype(np.int64)
        at = np.flatnonzero(n)
        of = np.repeat(at, n[at])
        step = np.arange(len(of)) - np.repeat(np.cumsum(n[at]) - n[at], n[at]) + 1
        sign = np.where(delta[of] > 0, 1, -1)
        crossed = base[of] + (level[of] + sign * step) * threshold
        part = (crossed - before[of]) / (now[of] - before[of])
        times = t[k - 1] + np.rint(np.clip(part, 0, 1) * (t[k] - t[k - 1])).astype(np.int64)
        parts.append((times, of, sign > 0))
        level[at] += np.where(delta[at] > 0, n[at], -n[at])
        before = now
    times, pixel, on = (np.concatenate(column) for column in zip(*parts))
    order = np.argsort(times, kind="stable")
    y, x = np.divmod(pixel[order], width)
    return EventStream(
        times[order], x.astype(np.uint16), y.astype(np.uint16), on[order].astype(np.uint8), width, height
    )
