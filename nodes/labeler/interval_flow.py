"""Where the surface points of an image are at another instant: flow over an interval, there and back.

Forward flow stands at the pixels of the interval's start and leads to its end, backward flow stands at those of the end
and leads to the start, both in px: the displacement of the surface point that the pixel's centre sees. It is known
wherever there is a surface. It is valid where the point is also in the image at the other instant, within half a pixel
of the outermost centres, and is what its place shows then: nothing nearer covers it, and its front faces the camera.
"""

from __future__ import annotations

import numpy as np

from nodes.labeler.motion_kernels import Motion
from nodes.labeler.sight import Sight

COVERED = 1e-4
"""By how much of its distance another surface has to be nearer to cover a point: above all float32 roundings."""


class IntervalFlow:
    """Computes flow between two instants for one camera."""

    def __init__(self, sight: Sight) -> None:
        self._sight = sight
        self._directions, _ = sight.pixels()

    def __call__(self, motion: Motion, envs: np.ndarray, start: int, end: int) -> tuple[np.ndarray, np.ndarray]:
        """Computes displacements of environments int64 [E] from `start` to `end` [ns], either of which may be the
        earlier.

        Returns float32 [E, H, W, 2] px, NaN where there is no surface, and whether each is valid, uint8 [E, H, W].
        """
        sight, (width, height) = self._sight, self._sight.size
        pixels = len(self._directions)
        env = np.repeat(envs.astype(np.int32), pixels)
        directions = np.tile(self._directions, (len(envs), 1))
        times = np.full(len(env), start, np.int64)
        ids, distances = sight.look(motion, env, times, directions)
        seen = np.flatnonzero(ids)
        points = directions[seen] * distances[seen, None].astype(np.float64)
        later = np.full(len(seen), end, np.int64)
        moved = sight.carried(motion, env[seen], times[seen], later, ids[seen], points)
        places = sight.project(moved)
        flow = np.full((len(env), 2), np.nan, np.float32)
        grid = np.stack((seen % pixels % width, seen % pixels // width), -1)
        flow[seen] = places - grid
        far = np.linalg.norm(moved, axis=-1)
        inside = ((places >= -0.5) & (places <= np.array([width, height]) - 0.5)).all(-1)
        there, reach = sight.look(motion, env[seen], later, moved / np.maximum(far, 1e-300)[:, None])
        open_to_view = (there == ids[seen]) & (np.abs(reach - far) <= COVERED * far)
        valid = np.zeros(len(env), np.uint8)
        valid[seen] = inside & open_to_view
        return flow.reshape(len(envs), height, width, 2), valid.reshape(len(envs), height, width)
