"""Finds how close z-buffers have to be in time to see things that are in the image for a short part of a gap alone."""

from __future__ import annotations

import numpy as np
import warp as wp

from evis.gpu.exchange import cpu_array
from nodes.interpolator.refine.instants import Instants
from nodes.interpolator.refine.probing.appearance_kernels import find_appearances
from nodes.interpolator.refine.probing.boxes import boxes_of
from nodes.interpolator.refine.probing.frustum import frustum_slopes
from nodes.interpolator.rigid.placement import Placement
from nodes.interpolator.rigid.slots import Poses
from nodes.renderer.raster.visibility import Visibility

TWICE = 2
"""Z-buffers in which a thing is seen that visits the image."""
DEEP = 0.125
"""Part of the image, of its width or height, into which it comes at least."""


class BriefAppearances:
    """Finds the shortest visit of what moves by itself, in one gap after another."""

    def __init__(self, visibility: Visibility, placement: Placement) -> None:
        v, movers = visibility, placement.movers
        geometry = v.geometry
        which = np.flatnonzero(np.isin(geometry.body, movers) & (geometry.body != v.camera_body))
        self._sides, self._size = frustum_slopes(v.view), v.shape[1:]
        self._count = len(which) if self._sides is not None else 0
        self._near, self._camera_body = float(v.view.near), v.camera_body
        camera = np.flatnonzero(movers == v.camera_body)
        self._camera = int(camera[0]) if len(camera) else -1
        self._boxes = boxes_of(v, movers, which)[0]

    def needed(
        self, instants: Instants, poses: Poses, least: int, missed: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gives how many z-buffers per coarse interval each environment needs for them, int64 [E], powers of two, and
        `least` at least; more than there are instants where one is too short. And int32 [E], whether something passes
        the near plane before the image, PASSES, or does so TOO_FAST. And as the first ones, for what is narrower than a
        pixel, and so may be on none in all z-buffers that would tell how fast it is, to go unseen over a part `missed`
        of all pixels at most. poses: at all instants of the gap."""
        envs, most = poses.rest.shape[0], 1 << instants.depth
        if not self._count or self._sides is None:
            return np.full(envs, least), np.zeros(envs, np.int32), np.full(envs, least)
        sides = self._sides
        deep = DEEP * min(sides[1] - sides[0], sides[3] - sides[2])
        shortest: wp.array = wp.full(envs, instants.count, dtype=wp.int32, device="cpu")
        passing: wp.array = wp.zeros(envs, dtype=wp.int32, device="cpu")
        eye = cpu_array(np.ascontiguousarray(poses.rest[:, self._camera_body]), wp.transformd)
        moved = cpu_array(np.ascontiguousarray(poses.moved), wp.transformd)
        levels = max(most // least, 1).bit_length()
        unseen: wp.array = wp.zeros((envs, levels), dtype=wp.float64, device="cpu")
        scale = (self._size[1] - 1) / (sides[1] - sides[0])
        given = [self._boxes, self._camera, self._near, wp.vec4d(*sides), deep, scale, most / least, eye, moved]
        wp.launch(find_appearances, (envs, self._count), given, [shortest, passing, unseen], device="cpu")
        found = shortest.numpy()
        apart = np.maximum(found // TWICE, 1)
        needed = np.clip(most >> np.floor(np.log2(apart)).astype(np.int64), least, None)
        enough = unseen.numpy() <= missed * self._size[0] * self._size[1]
        narrow = np.where(enough.any(axis=1), least << enough.argmax(axis=1), 2 * most)
        return np.where(found > 0, needed, 2 * most), passing.numpy(), narrow
