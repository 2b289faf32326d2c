"""Films with a closed form, given to the frame camera gap by gap."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from nodes.frame_camera.camera import FrameCamera, Shot
from nodes.frame_camera.parameters import settings_of

MS = 1_000_000
LINEAR = {"image_sensitivity": 1e6, "full_well": 10000.0, "image_bits": 16}
"""A radiance of 1 fills the well in 10 ms."""


def rows_of(envs: int, stamp: int, seed: int = -1, number: int = 0) -> np.ndarray:
    """Rows of msgs.own_time of environments that share their time."""
    rows = np.zeros((envs, 4), np.int64)
    rows[:, 0], rows[:, 2], rows[:, 3] = stamp, seed, number
    return rows


def film(
    light: Callable[[float], np.ndarray], end_ms: int, step_ms: float, count: int, *, envs: int = 1, seed: int = 0,
    device: str = "cpu", defocus_px: float = 0.0, name: str = "cam0", **given: Any,
) -> tuple[list[Shot], FrameCamera]:  # fmt: skip
    """Exposes a film from 0 to `end_ms`, given as gaps of `step_ms` with `count` frames each.

    light: of a time [ms] the radiance [H, W]. Returns the images, and the camera.
    """
    settings = settings_of("camera", given.pop("preset", "ideal"), {**LINEAR, **given})
    first = np.asarray(light(0.0), np.float32)
    camera = FrameCamera(settings, range(seed, seed + envs), (*first.shape, 1), device, defocus_px, name)
    found, at = [], 0
    whole = np.broadcast_to(first, (envs, 1, *first.shape))
    found += camera.push(whole, np.zeros((envs, 1), np.int64), np.ones(envs, bool), rows_of(envs, 0))
    gaps = round(end_ms / step_ms)
    for gap in range(1, gaps + 1):
        end = round(gap * step_ms * MS)
        t = at + (end - at) * np.arange(1, count + 1, dtype=np.int64) // count
        frames = np.stack([np.asarray(light(ns / MS), np.float32) for ns in t.tolist()])
        given_t = np.broadcast_to(t, (envs, count))
        frames = np.broadcast_to(frames, (envs, *frames.shape))
        found += camera.push(frames, given_t, np.zeros(envs, bool), rows_of(envs, end))
        at = end
    return found, camera
