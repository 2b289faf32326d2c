"""The instances as occluders: one ray-tracing structure per mesh, and trees over many instances."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from evis.scene.model import Mesh
from nodes.renderer.lights_shadow_kernels import Casters
from nodes.renderer.poses import Frames
from nodes.renderer.visibility import Visibility, store

TREE_FROM = 16
"""Instances from which on a tree is faster than trying each one's bounding sphere."""

WORN = 0.5
"""Movers that have gone on average this many times their size since the tree was built let it be built anew."""


class Occluders:
    """`casters`, for lights_shadow_kernels, of a visibility's instances; call `update` with every new frames.

    still: bool [I]. active: False leaves all meshes out. trees: None for trees from TREE_FROM instances on.
    """

    def __init__(self, visibility: Visibility, still: np.ndarray, active: bool, trees: bool | None = None) -> None:
        geometry, put = visibility.geometry, visibility.put
        self._visibility = visibility
        self._blas: dict[int, wp.Mesh] = {}
        ids = np.array([self._mesh(mesh) if active else 0 for mesh in geometry.meshes], np.uint64)
        order = np.argsort(~still, kind="stable")
        order = order[ids[order] != 0]
        count = int(still[order].sum())
        self._half = half_extents(visibility)
        self._still, self._moving = order[:count], order[count:]
        self.casters = casters = Casters()
        casters.mesh, casters.order = put(ids, wp.uint64), put(order, wp.int32)
        casters.radius, casters.shell = put(geometry.radius, wp.float32), put(geometry.shell, wp.int32)
        casters.still, casters.is_still = count, put(still.astype(np.int32), wp.int32)
        casters.turn = visibility.empty(visibility.envs, wp.mat33)
        casters.shift = visibility.empty(visibility.envs, wp.vec3)
        self._with_still, self._with_moving = (
            len(part) > 0 and (len(part) >= TREE_FROM if trees is None else trees)
            for part in (self._still, self._moving)
        )
        self.trees = self._with_still or self._with_moving
        self._still_tree: wp.Bvh | None = None
        self._moving_tree: wp.Bvh | None = None
        self._lower = self._upper = self.casters.shift
        self._built = np.zeros(0)

    def update(self, frames: Frames) -> None:
        """The trees for the instances where they are now."""
        pads = [0.0]
        if self._with_still:
            pads.append(self._place_still(frames))
        if self._with_moving:
            pads.append(self._place_moving(frames))
        self.casters.pad = 4e-6 * max(pads)

    def _place_still(self, frames: Frames) -> float:
        """The tree of still instances, built about their middle at the first call. Gives the size of its frame [m]."""
        rotation, translation = frames.body(-1)
        if self._still_tree is None:
            to_world = np.swapaxes(rotation[0], -1, -2)
            turn = to_world @ frames.rotation[0, self._still]
            centre = (frames.translation[0, self._still] - translation[0]) @ to_world.T
            self._middle = (centre.min(0) + centre.max(0)) / 2
            half = (np.abs(turn) @ self._half[self._still, :, None])[..., 0]
            box = centre - self._middle - half, centre - self._middle + half
            self._size = float(np.abs(box).max())
            lower, upper = (self._visibility.put(b, wp.vec3) for b in box)
            self._still_tree = wp.Bvh(lower, upper, constructor="sah")
            self.casters.still_tree = self._still_tree.id
        back = np.swapaxes(rotation, -1, -2)
        shift = -(back @ translation[..., None])[..., 0] - self._middle
        store(self.casters.turn, back)
        store(self.casters.shift, shift)
        return self._size + float(np.linalg.norm(shift, axis=-1).max())

    def _place_moving(self, frames: Frames) -> float:
        """The tree of moving instances, refitted, or built anew where it fits badly. Gives the frame's size [m]."""
        centre = frames.translation[:, self._moving]
        half = (np.abs(frames.rotation[:, self._moving]) @ self._half[self._moving, :, None])[..., 0]
        centre, half = centre.reshape(-1, 3), half.reshape(-1, 3)
        lower, upper = centre - half, centre + half
        fits = False
        if self._moving_tree is not None:
            gone = np.linalg.norm((centre - self._built) - (centre - self._built).mean(0), axis=1).mean()
            fits = gone <= WORN * np.linalg.norm(half, axis=1).mean()
        if self._moving_tree is not None:
            store(self._lower, lower)
            store(self._upper, upper)
            if fits:
                self._moving_tree.refit()
        if not fits:
            self._build_moving(lower, upper)
            self._built = centre
        return float(np.abs(centre).max() + half.max())

    def _build_moving(self, lower: np.ndarray, upper: np.ndarray) -> None:
        if self._moving_tree is not None:
            self._moving_tree.rebuild()
            return
        put, envs = self._visibility.put, self._visibility.envs
        self._lower, self._upper = put(lower, wp.vec3), put(upper, wp.vec3)
        groups = put(np.repeat(np.arange(envs), len(self._moving)), wp.int32)
        self._moving_tree = wp.Bvh(self._lower, self._upper, groups=groups)
        self.casters.moving_tree = self._moving_tree.id

    def _mesh(self, mesh: Mesh) -> int:
        """Id of the ray-tracing structure of a mesh, built once for all its instances; 0 for an empty one."""
        if not len(mesh.faces):
            return 0
        if id(mesh) not in self._blas:
            points = np.asarray(mesh.vertices, np.float64)
            points = points - (points.min(0) + points.max(0)) / 2
            put: Any = self._visibility.put
            self._blas[id(mesh)] = wp.Mesh(
                points=put(points, wp.vec3),
                indices=put(np.asarray(mesh.faces).reshape(-1), wp.int32),
                bvh_constructor="sah",
            )
        return int(self._blas[id(mesh)].id)


def half_extents(visibility: Visibility) -> np.ndarray:
    """Half the sides of every instance's box in its own frame, float64 [I, 3] m."""
    geometry = visibility.geometry
    half = np.zeros((len(geometry.body), 3))
    np.maximum.at(half, geometry.vertex_instance, np.abs(geometry.vertices))
    return half * (1 + 1e-6)
