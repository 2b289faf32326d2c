"""Finds how close z-buffers have to be in time to follow things that do not move straight from one to the next."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from evis.gpu.exchange import cpu_array
from nodes.interpolator.refine.instants import Instants
from nodes.interpolator.refine.probing.body_boxes import BodyBoxes
from nodes.interpolator.refine.probing.curved_motion_kernels import BoundingSpheres, CurvatureLimits, find_curved_motion
from nodes.interpolator.refine.probing.frustum import frustum_slopes
from nodes.interpolator.rigid.placement import Placement
from nodes.interpolator.rigid.slots import Poses
from nodes.renderer.raster.visibility import Visibility

EVEN = 0.1
"""Distance [px] from a straight way up to which a thing counts as on it."""
LATE = 0.5
"""Tolerances of time by which it may be early or late on it."""
NO_SIDES = (0.0, 0.0, 0.0, 0.0)
FAR = 1e6
"""Distance [m] taken where there is nothing but the sky."""


class CurvedMotion:
    """Finds how far what moves in the image is off straight ways, in one gap after another."""

    def __init__(self, visibility: Visibility, placement: Placement, tolerance_ns: float) -> None:
        """Puts boxes about what moves and what stands still. tolerance_ns: greatest error wanted in the time of a
        threshold crossing [ns]."""
        v, movers = visibility, placement.movers
        geometry = v.geometry
        self._tolerance_ns = tolerance_ns
        # Boxes of what moves by itself, body by body, and of all that stands still.
        on_mover = np.isin(geometry.body, movers)
        which = np.flatnonzero(on_mover & (geometry.body != v.camera_body))
        which = which[np.argsort(geometry.body[which], kind="stable")]
        still = np.flatnonzero(~on_mover & (geometry.body != v.camera_body))
        self._moving, self._still = (BodyBoxes(v, instances) for instances in (which, still))
        bodies, self._first = np.unique(geometry.body[which], return_index=True)
        reach = np.linalg.norm(self._moving.translation, axis=1) + np.linalg.norm(self._moving.half, axis=1)
        radius = np.maximum.reduceat(reach, self._first) if len(which) else np.zeros(0)
        camera = np.flatnonzero(movers == v.camera_body)
        self._camera_body, self._near = v.camera_body, float(v.view.near)
        self._camera = int(camera[0]) if len(camera) else -1
        self._movers, self._sides = movers, frustum_slopes(v.view)
        self._pixel = 1.0 / max(v.view.fx, v.view.fy)
        # All that is here is on the host, where the poses are.
        with wp.ScopedDevice("cpu"):
            self._balls: Any = BoundingSpheres()
            self._balls.mover = wp.array(np.searchsorted(movers, bodies).astype(np.int32), dtype=wp.int32)
            self._balls.radius = wp.array(radius, dtype=wp.float64)

    def needed(self, instants: Instants, poses: Poses, length_ns: int, least: int, most: int) -> np.ndarray:
        """Gives how many z-buffers per coarse interval each environment needs for them, int64 [E], powers of two,
        `least` at least, and 2 `most` where that is not enough.

        poses: at all instants of the gap. length_ns: of the gap.
        """
        envs, balls = poses.rest.shape[0], self._balls
        late = LATE * self._tolerance_ns * instants.count / max(length_ns, 1)
        sides = self._sides or NO_SIDES
        needed = np.full(envs, least, np.int32)
        balls.away = cpu_array(self._away(poses))
        balls.eye = cpu_array(np.ascontiguousarray(poses.rest[:, self._camera_body]), wp.transformd)
        start = cpu_array(np.ascontiguousarray(poses.before[:, self._movers]), wp.transformd)
        moved = cpu_array(np.ascontiguousarray(poses.moved), wp.transformd)
        limits: Any = CurvatureLimits()
        limits.camera, limits.whole, limits.sides = self._camera, int(self._sides is None), wp.vec4d(*sides)
        limits.even, limits.late = EVEN * self._pixel, late
        given = [balls, limits, instants.coarse, least, most, start, moved]
        wp.launch(find_curved_motion, (envs, balls.mover.size + 1), given, [cpu_array(needed)], device="cpu")
        return needed.astype(np.int64)

    def _away(self, poses: Poses) -> np.ndarray:
        """Gives how far from the cameras the nearest side of a box of each ball is, float64 [E, balls] m: at the start
        or the end of the gap, of what stands still at its end."""
        away = np.full((len(poses.rest), len(self._first) + 1), FAR)
        if len(self._first):
            for then in (poses.before, poses.rest):
                sides = self._moving.sides(then, then[:, self._camera_body, :3])
                away[:, :-1] = np.minimum(away[:, :-1], np.minimum.reduceat(sides, self._first, axis=1))
        # A still world is on a straight way before a still camera.
        if self._camera >= 0 and len(self._still.body):
            away[:, -1] = self._still.sides(poses.rest, poses.rest[:, self._camera_body, :3]).min(axis=1)
        return np.clip(away, self._near, FAR)
