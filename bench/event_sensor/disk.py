"""A high-dynamic-range test picture: a spinning disk of patches before a drifting exponential ramp.

The patches have albedo 0.1 or 0.6 under an irradiance of 100, a fifth more on one side than in the middle, so that
every pixel returns to values of its own; radius 120 px, 50 rad/s. Behind them the radiance grows from 1e-2 to 1e3
across the picture and drifts at 100 px/s.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import warp as wp

from bench.event_sensor.signals import SECOND, Recording
from evis.events.measure.distance import EventStream

RINGS, SECTORS = 4, 16
RADIUS = wp.constant(wp.float64(120.0))
SPIN = wp.constant(wp.float64(50.0))
DRIFT = wp.constant(wp.float64(100.0))
SPAN = wp.constant(wp.float64(math.log(1e5)))
TOLERANCE = 1e-6
"""Of a threshold: what a crossing may be missed by and still count, in the reference."""


@wp.kernel(enable_backward=False)
def draw(
    # in
    t: wp.array(dtype=wp.float64),
    patches: wp.array2d(dtype=wp.float64),
    soft: wp.float64,
    # out
    luminance: wp.array3d(dtype=wp.float32),
    dlog_dt: wp.array3d(dtype=wp.float32),
):
    """Draws the picture at one instant.

    soft: width of the edges between sectors [px], 1 as by a box filter, 0 as by point samples."""
    k, y, x = wp.tid()
    half = wp.float64(0.5)
    width = wp.float64(luminance.shape[2])
    px = wp.float64(x) + half - half * width
    py = wp.float64(y) + half - half * wp.float64(luminance.shape[1])
    r = wp.sqrt(px * px + py * py)
    rate = SPAN * DRIFT / width
    value = wp.float64(0.01) * wp.exp(SPAN * (wp.float64(x) + half) / width + rate * t[k])
    if r < RADIUS:
        sectors = wp.float64(patches.shape[1])
        pitch = wp.float64(2.0 * wp.pi) / sectors
        turns = (wp.atan2(py, px) - SPIN * t[k]) / pitch
        inside = turns - wp.floor(turns)
        sector = wp.int32(wp.floor(turns)) % patches.shape[1]
        if sector < 0:
            sector += patches.shape[1]
        ring = wp.int32(r / RADIUS * wp.float64(patches.shape[0]))
        mine = patches[ring, sector]
        # Distance to the nearer edge [px]; the other side's share falls from 1/2 at the edge to 0 at soft / 2.
        side = wp.where(inside < half, -1, 1)
        away = wp.min(inside, wp.float64(1.0) - inside) * pitch * r
        other = patches[ring, (sector + side + patches.shape[1]) % patches.shape[1]]
        share = wp.float64(0.0)
        change = wp.float64(0.0)
        if away < half * soft:
            share = half - away / soft
            change = (other - mine) * wp.where(side < 0, SPIN * r / soft, -SPIN * r / soft)
        value = mine + (other - mine) * share
        rate = change / value
        value = value * (wp.float64(1.0) + wp.float64(0.2) * px / RADIUS)
    luminance[k, y, x] = wp.float32(value)
    dlog_dt[k, y, x] = wp.float32(rate)


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
