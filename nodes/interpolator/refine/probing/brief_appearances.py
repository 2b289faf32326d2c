"""Finds how close z-buffers have to be in time to see things that are in the image for a short part of a gap alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from evis.gpu.exchange import cpu_array
from nodes.interpolator.refine.instants import Instants
from nodes.interpolator.refine.probing.appearance_kernels import Boxes, find_appearances
from nodes.interpolator.rigid.placement import Placement
from nodes.interpolator.rigid.slots import Poses
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.shadows.boxes import half_extents

TWICE = 2
"""Z-buffers in which a thing is seen that visits the image."""
DEEP = 0.125
"""Part of the image, of its width or height, into which it comes at least."""
LEAST_Z = 0.05
"""z of a ray of length 1 below which the image is too wide to have four sides."""


class BriefAppearances:
    """Finds the shortest visit of what moves by itself, in one gap after another."""

    def __init__(self, visibility: Visibility, placement: Placement) -> None:
        v, movers = visibility, placement.movers
        geometry = v.geometry
        which = np.flatnonzero(np.isin(geometry.body, movers) & (geometry.body != v.camera_body))
        self._sides = sides_of(v)
        self._count = len(which) if self._sides is not None else 0
        self._near, self._camera_body = float(v.view.near), v.camera_body
        camera = np.flatnonzero(movers == v.camera_body)
        self._camera = int(camera[0]) if len(camera) else -1
        self._boxes = boxes_of(v, movers, which)[0]

    def needed(self, instants: Instants, poses: Poses, least: int) -> tuple[np.ndarray, np.ndarray]:
        """Gives how many z-buffers per coarse interval each environment needs for them, int64 [E], powers of two, and
        `least` at least; more than there are instants where one is too short. And bool [E], whether something passes
        the near plane before the image. poses: at all instants of the gap."""
        envs, most = poses.rest.shape[0], 1 << instants.depth
        if not self._count or self._sides is None:
            return np.full(envs, least), np.zeros(envs, bool)
        sides = self._sides
        deep = DEEP * min(sides[1] - sides[0], sides[3] - sides[2])
        shortest: wp.array = wp.full(envs, instants.count, dtype=wp.int32, device="cpu")
        passing: wp.array = wp.zeros(envs, dtype=wp.int32, device="cpu")
        eye = cpu_array(np.ascontiguousarray(poses.rest[:, self._camera_body]), wp.transformd)
        moved = cpu_array(np.ascontiguousarray(poses.moved), wp.transformd)
        given = [self._boxes, self._camera, self._near, wp.vec4d(*sides), deep, eye, moved]
        wp.launch(find_appearances, (envs, self._count), given, [shortest, passing], device="cpu")
        found = shortest.numpy()
        apart = np.maximum(found // TWICE, 1)
        needed = np.clip(most >> np.floor(np.log2(apart)).astype(np.int64), least, None)
        return np.where(found > 0, needed, 2 * most), passing.numpy() > 0


def boxes_of(
    visibility: Visibility, movers: np.ndarray, which: np.ndarray, fine: np.ndarray | None = None
) -> tuple[Any, int]:
    """Makes Boxes of some instances, on the host, where the poses are, and tells how many there are. fine: of all
    instances, float64 [I, 3] m, where it is asked for."""
    geometry, boxes = visibility.geometry, Boxes()
    with wp.ScopedDevice("cpu"):
        boxes.mover = wp.array(np.searchsorted(movers, geometry.body[which]).astype(np.int32), dtype=wp.int32)
        boxes.rotation = wp.array(geometry.rotation[which], dtype=wp.mat33d)
        boxes.translation = wp.array(geometry.translation[which], dtype=wp.vec3d)
        boxes.half = wp.array(half_extents(visibility)[which], dtype=wp.vec3d)
        if fine is not None:
            boxes.fine = wp.array(fine[which], dtype=wp.vec3d)
    return boxes, len(which)


def sides_of(visibility: Visibility) -> tuple[float, float, float, float] | None:
    """Gives the least and greatest x / z, then y / z, of a camera's rays; None where it looks too far sideways."""
    view = visibility.view
    if view.distorted:
        rays = view.rays.numpy().reshape(-1, 3)
        if rays[:, 2].min() < LEAST_Z:
            return None
        across, down = (rays[:, axis] / rays[:, 2] for axis in (0, 1))
    else:
        across, down = view.columns.numpy(), view.rows.numpy()
    return float(across.min()), float(across.max()), float(down.min()), float(down.max())
