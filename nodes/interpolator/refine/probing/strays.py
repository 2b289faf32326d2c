"""Things that do not go straight from one z-buffer to the next: how close z-buffers have to be to follow them."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from evis.geometry import se3
from nodes.interpolator.refine.instants import Instants
from nodes.interpolator.refine.probing.stray_kernels import Balls, find_strays
from nodes.interpolator.refine.probing.visits import sides_of
from nodes.interpolator.rigid.placement import Placement
from nodes.interpolator.rigid.slots import Slots
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.shadows.occlusion import half_extents

EVEN = 0.25
"""Distance [px] from a straight way up to which a thing counts as on it."""
LATE = 0.5
"""Tolerances of time by which it may be early or late on it."""
NO_SIDES = (0.0, 0.0, 0.0, 0.0)
FAR = 1e6
"""Distance [m] taken where there is nothing but the sky."""


class Strays:
    """Finds how far what moves in the image is off straight ways, in one gap after another."""

    def __init__(self, visibility: Visibility, placement: Placement, tolerance_ns: float) -> None:
        """tolerance_ns: greatest error wanted in the time of a threshold crossing [ns]."""
        v, movers = visibility, placement.movers
        geometry = v.geometry
        self._tolerance_ns = tolerance_ns
        # Boxes of what moves by itself, in the order of bodies, then of all that stands still.
        on_mover = np.isin(geometry.body, movers)
        which = np.flatnonzero(geometry.body != v.camera_body)
        which = which[np.lexsort((geometry.body[which], ~on_mover[which]))]
        self._body, half = geometry.body[which], half_extents(v)[which]
        self._boxes = geometry.rotation[which], geometry.translation[which], half
        reach = np.linalg.norm(geometry.translation[which], axis=1) + np.linalg.norm(half, axis=1)
        moving = int(on_mover[which].sum())
        bodies, self._first = np.unique(self._body[:moving], return_index=True)
        radius = np.maximum.reduceat(reach[:moving], self._first) if moving else np.zeros(0)
        if moving < len(which):
            self._first = np.append(self._first, moving)
        camera = np.flatnonzero(movers == v.camera_body)
        self._camera_body, self._near = v.camera_body, float(v.view.near)
        self._camera = int(camera[0]) if len(camera) else -1
        self._movers, self._sides = movers, sides_of(v)
        self._pixel = 1.0 / max(v.view.fx, v.view.fy)
        # All that is here is on the host, where the poses are.
        with wp.ScopedDevice("cpu"):
            self._balls: Any = Balls()
            self._balls.mover = wp.array(np.searchsorted(movers, bodies).astype(np.int32), dtype=wp.int32)
            self._balls.radius = wp.array(radius, dtype=wp.float64)

    def needed(self, instants: Instants, places: Slots, length_ns: int, least: int, most: int) -> np.ndarray:
        """Gives how many z-buffers per coarse interval each environment needs for them, int64 [E], powers of two,
        `least` at least, and 2 `most` where that is not enough.

        places: at all instants of the gap. length_ns: of the gap.
        """
        envs, balls = places.rest.shape[0], self._balls
        late = LATE * self._tolerance_ns * instants.count / max(length_ns, 1)
        sides = self._sides or NO_SIDES
        with wp.ScopedDevice("cpu"):
            needed: wp.array = wp.full(envs, least, dtype=wp.int32)
            balls.away = wp.array(self._away(places, balls.mover.size + 1), dtype=wp.float64)
            balls.eye = wp.array(np.ascontiguousarray(places.rest[:, self._camera_body]), dtype=wp.transformd)
            start: wp.array = wp.array(np.ascontiguousarray(places.before[:, self._movers]), dtype=wp.transformd)
            poses: wp.array = wp.array(np.ascontiguousarray(places.moved), dtype=wp.transformd)
            given = [balls, self._camera, int(self._sides is None), wp.vec4d(*sides), instants.coarse, least, most]
            given += [EVEN * self._pixel, late, start, poses]
            wp.launch(find_strays, (envs, balls.mover.size + 1), given, [needed])
        return needed.numpy().astype(np.int64)

    def _away(self, places: Slots, count: int) -> np.ndarray:
        """Gives how far from the cameras the nearest side of a box of each ball is, float64 [E, count] m, at the start
        or the end of the gap."""
        away = np.full((len(places.rest), count), np.inf)
        for poses in (places.before, places.rest):
            # The world's own boxes are on body -1.
            world = np.broadcast_to(se3.IDENTITY, (len(poses), 1, 7))
            stand = np.concatenate([poses, world], axis=1)[:, self._body]
            rotation, translation, half = self._boxes
            turn = se3.to_matrix(stand[..., 3:])
            middle = stand[..., :3] + np.einsum("enij,nj->eni", turn, translation)
            off = poses[:, self._camera_body, None, :3] - middle
            at = np.abs(np.einsum("enji,enj->eni", turn @ rotation, off)) - half
            outside = np.linalg.norm(np.maximum(at, 0.0), axis=-1)
            sides = outside + np.maximum(-at.max(axis=-1), 0.0)
            if len(self._first):
                nearest = np.minimum.reduceat(sides, self._first, axis=1)
                away[:, : len(self._first)] = np.minimum(away[:, : len(self._first)], nearest)
        return np.clip(away, self._near, FAR)
