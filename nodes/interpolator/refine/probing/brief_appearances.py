"""Finds how close z-buffers have to be in time to see things that are in the image for a short part of a gap alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from evis.geometry import se3
from evis.gpu.exchange import cpu_array
from nodes.interpolator.refine.instants import Instants
from nodes.interpolator.refine.probing.appearance_kernels import TOO_FAST, follow_boxes, follow_still_boxes
from nodes.interpolator.refine.probing.body_boxes import BodyBoxes
from nodes.interpolator.refine.probing.boxes import boxes_of
from nodes.interpolator.refine.probing.frustum import frustum_slopes
from nodes.interpolator.refine.probing.narrow_kernels import NARROW
from nodes.interpolator.rigid.placement import Placement
from nodes.interpolator.rigid.slots import Poses
from nodes.renderer.raster.visibility import Visibility

TWICE = 2
"""Z-buffers in which a thing is seen that visits the image."""
DEEP = 0.125
"""Part of the image, of its width or height, into which it comes at least."""

LOOKS = 16
"""Times per gap at which what stands still is looked at: only the camera's way counts, and there is much of it."""


@dataclass(frozen=True)
class BriefForecast:
    """Holds how many z-buffers per coarse interval each environment needs for what is seen briefly in a gap.

    visits int64 [E]: for what is in the image for a part of the gap alone. narrow, narrow_told int64 [E]: for what is
    narrower than a pixel to go unseen as seldom as is wanted, and so seldom that it need not be told. All are powers of
    two, twice as many as there are instants where those are too few. passing bool [E]:
    whether something passes the near plane before the image; swept bool [E]: so fast that instants show too little of
    it.
    """

    visits: np.ndarray
    narrow: np.ndarray
    narrow_told: np.ndarray
    passing: np.ndarray
    swept: np.ndarray


class BriefAppearances:
    """Finds what is in the image, or on a pixel, for a short time, in one gap after another."""

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
        # What stands still comes and goes with all that is about it, but may be on no pixel as well.
        still = np.flatnonzero(~np.isin(geometry.body, movers))
        self._still = BodyBoxes(v, still) if self._camera >= 0 and len(still) else None

    def needed(self, instants: Instants, poses: Poses, least: int, missed: float, told: float) -> BriefForecast:
        """Computes how many z-buffers a gap needs, `least` per coarse interval at least.

        poses: at all instants of the gap. missed, told: part of all pixels over which what is narrower than a pixel may
        go unseen, and may so without being told: it may be on none in all z-buffers that would tell how fast it is.
        """
        envs, most = poses.rest.shape[0], 1 << instants.depth
        if not (self._count or self._still) or self._sides is None:
            none, never = np.full(envs, least), np.zeros(envs, bool)
            return BriefForecast(none, none, none, never, never)
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
        wp.launch(follow_boxes, (envs, self._count), given, [shortest, passing, unseen], device="cpu")
        if self._still is not None:
            every = -(-instants.count // LOOKS)
            eyes, spacing = poses.moved[::every, :, self._camera], most / least / every
            view = [self._near, wp.vec4d(*sides), scale]
            self._follow_still(self._still, poses.rest, eyes, view, spacing, unseen)
        found = shortest.numpy()
        apart = np.maximum(found // TWICE, 1)
        needed = np.clip(most >> np.floor(np.log2(apart)).astype(np.int64), least, None)
        share = unseen.numpy() / (self._size[0] * self._size[1])
        narrow, narrow_told = (
            np.where(enough.any(axis=1), least << enough.argmax(axis=1), 2 * most)
            for enough in (share <= missed, share <= told)
        )
        passes = passing.numpy()
        visits = np.where(found > 0, needed, 2 * most)
        return BriefForecast(visits, narrow, narrow_told, passes > 0, passes == int(TOO_FAST))

    def _follow_still(
        self, still: BodyBoxes, rest: np.ndarray, eyes: np.ndarray, view: list[Any], spacing: float, unseen: wp.array
    ) -> None:
        """Adds to `unseen` [E, levels] what stands still and goes unseen.

        rest: poses of all bodies [E, N, 7]; eyes: of the camera [n, E, 7]. view: near, sides and scale of
        follow_still_boxes, and spacing as there.
        """
        middle, axes = still.place(rest)
        gone = np.linalg.norm(np.diff(eyes[..., :3], axis=0), axis=-1).sum(axis=0)
        farthest = np.linalg.norm(middle - eyes[0, :, None, :3], axis=-1) + gone[:, None]
        # From nowhere on the camera's way is a box narrower than its least side from as far away as it can be.
        env, box = np.nonzero(2.0 * view[2] * still.half.min(axis=1) < float(NARROW) * farthest)
        if not len(env):
            return
        back = np.swapaxes(se3.to_matrix(eyes[..., 3:]), -1, -2)
        boxes = [cpu_array(env.astype(np.int32)), cpu_array(middle[env, box], wp.vec3d)]
        boxes += [cpu_array(axes[env, box], wp.mat33d), cpu_array(still.half[box], wp.vec3d)]
        eye, turned = np.ascontiguousarray(eyes[..., :3]), np.ascontiguousarray(back)
        given = [*boxes, *view, spacing, cpu_array(eye, wp.vec3d), cpu_array(turned, wp.mat33d)]
        wp.launch(follow_still_boxes, len(env), given, [unseen], device="cpu")
