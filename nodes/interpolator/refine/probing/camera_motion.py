"""Finds how bodies move against the camera, from poses at two instants shortly after each other."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from evis.geometry import se3
from nodes.interpolator.displacement_kernels import BodyMotion, displace

FASTER, STILL = 1.25, 1e-9
"""How many times faster than at the frames something has to be between them for speeds to be found there too, and ways
[m, rad] up to which it is at rest: on the drone, whose propellers turn evenly, that takes 3 % of a gap's time."""


def faster_between(
    at_frames: tuple[np.ndarray, np.ndarray], between: tuple[np.ndarray, np.ndarray], camera_body: int, envs: int
) -> np.ndarray:
    """Tells in which environments a body moves faster against the camera between frames than at any, bool [E].

    at_frames, between: poses as of `ProbeForecast.pairs`.
    """
    slow, fast = (motion_against_camera(*pair, camera_body, envs).max(axis=0) for pair in (at_frames, between))
    return np.asarray((fast > FASTER * slow + STILL).any(axis=(1, 2)))


def motion_against_camera(now: np.ndarray, then: np.ndarray, camera_body: int, envs: int) -> np.ndarray:
    """Computes how far bodies, and last the world, go and turn against the camera from poses `then` to poses `now`.

    Poses [n E, N, 7]; returns float64 [n, E, N + 1, 2], m and rad.
    """
    seen = []
    for poses in (now, then):
        eye = se3.inverse(poses[:, camera_body])[:, None]
        seen.append(np.concatenate([se3.compose(eye, poses), eye], axis=1))
    gone = np.linalg.norm(seen[0][..., :3] - seen[1][..., :3], axis=-1)
    turned = se3.angle(se3.multiply(se3.conjugate(seen[1][..., 3:]), seen[0][..., 3:]))
    return np.stack([gone, turned], axis=-1).reshape(-1, envs, now.shape[1] + 1, 2)


def displaced_against_camera(now: np.ndarray, then: np.ndarray, camera_body: int, device: Any) -> wp.array:
    """Computes on the device how bodies move against the camera from poses `then` to poses `now`, [rows, N, 7].

    Returns BodyMotion [rows, N + 2].
    """
    given: list[Any] = [wp.array(p, dtype=wp.transformd, device=device) for p in (now, then)]
    with wp.ScopedDevice(device):
        motions = wp.empty((now.shape[0], now.shape[1] + 2), dtype=BodyMotion)
        wp.launch(displace, motions.shape, [camera_body, *given], [motions])
    return motions
