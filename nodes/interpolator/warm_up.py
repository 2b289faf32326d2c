"""Makes up keyframes for an interpolator to build, compile and record what it needs before the first real one."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from evis.geometry import se3
from evis.scene.model import Camera, Scene
from nodes.interpolator.keyframe import States

GAP_NS = 10_000_000
"""Length of the gap between two of them [ns]."""
LONGEST = 64
"""Frames of a gap from which on a warm-up with one takes longer than what it saves."""
RECORDED = 4
"""Gaps until all is recorded on a GPU: two keyframes take turns in memory, and each time the first gap loads kernels
and the second one is recorded."""
SWAY = 1e-3
"""Turn of the camera between two keyframes [rad], for else there might be nothing to look up."""

Images = tuple[np.ndarray, np.ndarray, np.ndarray]


def images(envs: int, height: int, width: int) -> Images:
    """Gives the radiance, depth and motion of a grey wall that stands still; sizes with margin [px]."""
    radiance, depth, motion = (np.ones((envs, height, width, *tail), np.float32) for tail in ((3,), (), (2,)))
    return radiance, depth, 0.0 * motion


def stamps(gaps: int) -> Iterator[int]:
    """Gives the stamps of the keyframes about so many gaps [ns]."""
    return iter(range(0, (gaps + 1) * GAP_NS, GAP_NS))


def states(scene: Scene, camera: Camera, envs: int, stamp_ns: int) -> States:
    """Gives states of the bodies in the interval that ends at a stamp: on their paths, or at rest at the origin."""
    t = np.array([stamp_ns - GAP_NS, stamp_ns]) if stamp_ns else np.zeros(1, np.int64)
    pose = np.tile(se3.IDENTITY, (envs, len(t), len(scene.bodies), 1))
    for n, body in enumerate(scene.bodies):
        if body.trajectory is not None:
            pose[:, :, n] = body.trajectory.pose(t)
        if body.name == camera.name:
            turn = np.zeros((len(t), 3))
            turn[:, 0] = SWAY * (t // GAP_NS % 2)
            pose[:, :, n, 3:] = se3.multiply(pose[:, :, n, 3:], se3.exp(turn))
    return States(t, pose, np.zeros((*pose.shape[:3], 6)))
