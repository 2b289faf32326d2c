"""Interpolates poses of many environments between two steps of MuJoCo, by the kernel that interpolates poses everywhere
else too."""

from __future__ import annotations

import numpy as np

from evis.geometry.interpolate import NS
from evis.geometry.interpolate_kernels import place_between
from evis.gpu.exchange import cpu_array
from evis.gpu.repeated_launch import RepeatedLaunch


class PosesBetween:
    """Writes the poses between two steps, of arrays that stay where they are."""

    def __init__(self, poses: np.ndarray, twists: np.ndarray, result: np.ndarray) -> None:
        """Takes the arrays that are read and written. poses: float64 [E, 2, n, 7] at two times. twists: float64 [E, 2,
        n, 6]. result: float64 [E, n, 7], which is written."""
        every, first = np.arange(poses.shape[2], dtype=np.int32), np.zeros(1, np.int32)
        self._share, self._length, self._result = np.zeros(1), np.zeros(1), result
        arrays = [poses, twists, every, every, first, self._share, self._length, result[None]]
        self._launch = RepeatedLaunch(place_between, [cpu_array(values) for values in arrays])

    def aim(self, t: int, times: np.ndarray) -> None:
        """Takes t [ns] and the two times, int64 [2] ns, between which it lies."""
        gap = int(times[1] - times[0])
        self._share[0], self._length[0] = (t - int(times[0])) / gap, gap * NS

    def write(self, part: slice | None = None) -> None:
        """Writes the poses of all environments, or of a part of them while others write the rest, as
        `evis.geometry.interpolate.pose_at` computes them at the time last taken."""
        if part is None:
            self._launch.whole(len(self._result))
        else:
            self._launch.part(part.start, len(self._result[part]))
