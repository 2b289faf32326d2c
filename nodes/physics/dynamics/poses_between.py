"""Interpolates poses of many environments between two steps of MuJoCo, by the kernel that interpolates poses everywhere
else too."""

from __future__ import annotations

import numpy as np
import warp as wp

from evis.geometry.interpolate import NS
from evis.geometry.interpolate_kernels import place_between
from evis.gpu.exchange import cpu_array
from evis.warp_start import start_warp

start_warp()


def poses_between(t: int, times: np.ndarray, poses: np.ndarray, twists: np.ndarray) -> np.ndarray:
    """Computes the poses [E, n, 7] at t [ns], as `evis.geometry.interpolate.pose_at` does.

    times: int64 [2] ns, before and after t. poses: float64 [E, 2, n, 7] at those times. twists: float64 [E, 2, n, 6].
    """
    envs, _, bodies, _ = poses.shape
    result = np.empty((1, envs, bodies, 7))
    gap = int(times[1] - times[0])
    every, first = np.arange(bodies, dtype=np.int32), np.zeros(1, np.int32)
    share, length = np.array([(t - int(times[0])) / gap]), np.array([gap * NS])
    arrays = [poses, twists, every, every, first, share, length, result]
    wp.launch(place_between, envs, [0, *map(cpu_array, arrays)], device="cpu")
    return result[0]
