"""The grids of spot lights that stand still, see grid_kernels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from evis.geometry import se3
from nodes.renderer.geometry.triangles import is_static
from nodes.renderer.shadows import grid_kernels, occlusion_kernels
from nodes.renderer.shadows.occlusion import TREE_FROM, half_extents

if TYPE_CHECKING:
    from nodes.renderer.raster.visibility import Visibility
    from nodes.renderer.shadows.occlusion import Occluders

WIDEST = np.deg2rad(80.0)
"""Half angle of a cone up to which it has a grid, which lies in a plane before the light."""

SLACK = 1e-4
"""How much wider the boxes in a grid are than what is in them, of the size of the scene: rays are this much beside the
line through the light that tells their cell, and more only from places ten times as far away as the scene is large."""

SIDE, COARSE = int(grid_kernels.SIDE), int(grid_kernels.COARSE)
BEFORE = float(grid_kernels.BEFORE)
SIGNS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)


class ShadowGrid:
    """Makes `kernel` (grid_kernels.Grid) of some lights; `place` it for every new instant."""

    def __init__(self, visibility: Visibility, occluders: Occluders, lights: list[int]) -> None:
        """lights: those that `suits` is true of."""
        v = self._v = visibility
        self._occluders, self._lights = occluders, lights
        casters = occluders.casters
        order = casters.order.numpy()
        self._still, self._moving = order[: casters.still], len(order) - casters.still
        self._half = half_extents(v)[self._still]
        self._middle, self._size, self._built = np.zeros(3), 0.0, -1
        self.kernel = grid = grid_kernels.Grid()
        grid.turn, grid.shift = v.eye, v.empty(v.envs, wp.vec3)
        grid.pad = wp.zeros(v.envs, dtype=wp.float32, device=v.device)
        grid.masks = wp.zeros((v.envs, len(lights), COARSE * COARSE), dtype=wp.uint64, device=v.device)

    @staticmethod
    def suits(visibility: Visibility, occluders: Occluders, light: int) -> bool:
        """Tells whether a light can have a grid, and there is so much that it pays."""
        casters, given = occluders.casters, visibility.scene.lights[light]
        moving = casters.order.size - casters.still
        many = occluders.trees and casters.still >= TREE_FROM and moving <= int(grid_kernels.MOVERS)
        return many and given.kind == "spot" and given.cone[1] <= WIDEST and is_static(visibility.scene, given.body)

    def place(self) -> None:
        """Places the grid for the visibility's poses: launches only, after the occluders' tree is built."""
        v, grid = self._v, self.kernel
        if self._built != self._occluders.builds:
            self._built = self._occluders.builds
            self._build()
        given = [v.poses, v.camera_body, wp.vec3d(*self._middle), self._size]
        wp.launch(occlusion_kernels.place_trees, v.envs, given, [grid.shift, grid.pad], device=v.device)
        if self._moving:
            grid.masks.zero_()
            dim = (v.envs, len(self._lights), self._moving)
            wp.launch(grid_kernels.mark_movers, dim, [self._occluders.casters], [grid], device=v.device)

    def _build(self) -> None:
        """Boxes, cells and entries for where the still instances and the lights are."""
        v, grid, last = self._v, self.kernel, self._v.last
        assert last is not None
        frames = v.instance_poses(last)
        rotation, translation = frames.body(-1)
        to_world = np.swapaxes(rotation[0], -1, -2)
        turn = to_world @ frames.rotation[0, self._still]
        # In the world, then about the middle of all.
        centre = (frames.translation[0, self._still] - translation[0]) @ to_world.T
        middle = (centre.min(0) + centre.max(0)) / 2
        centre, self._middle = centre - middle, middle
        extent = (np.abs(turn) @ self._half[:, :, None])[..., 0]
        self._size = float((np.abs(centre) + extent).max())
        slack = grid.slack = SLACK * self._size
        corners = centre[:, None] + np.einsum("nij,nkj->nki", turn, SIGNS * (self._half + slack)[:, None])
        grid.lower, grid.upper = (v.put(centre + s * (extent + 2 * slack), wp.vec3) for s in (-1, 1))
        place, axes, tall = (np.array(a) for a in zip(*(self._frame(light, last) for light in self._lights)))
        place -= middle
        grid.place, grid.scale = v.put(place, wp.vec3), v.put(1 / tall, wp.float32)
        grid.right, grid.down, grid.ahead = (v.put(axes[:, k], wp.vec3) for k in range(3))
        parts = [fill((corners - p) @ a.T, t) for p, a, t in zip(place, axes, tall)]
        count = np.cumsum([0, *(len(entries) for _, entries in parts)])
        everybody = np.zeros((len(self._still), 2), np.int32)
        everybody[:, 0] = np.arange(len(self._still))
        starts = [*(starts + n for (starts, _), n in zip(parts, count)), [count[-1], count[-1] + len(everybody)]]
        grid.cells = v.put(np.concatenate(starts), wp.int32)
        grid.entries = v.put(np.concatenate([*(entries for _, entries in parts), everybody]), wp.vec2i)

    def _frame(self, index: int, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Place [3] and axes [3, 3] (right, down, ahead) of a light in the world, and the tan of its cone, a bit more
        for rounding. poses: of all bodies, float64 [E, N, 7]."""
        light = self._v.scene.lights[index]
        place, ahead = np.asarray(light.vector, np.float64), np.asarray(light.direction, np.float64)
        if light.body >= 0:
            pose = poses[0, light.body]
            tip = se3.transform(pose, place + ahead)
            place = se3.transform(pose, place)
            ahead = tip - place
        ahead = ahead / np.linalg.norm(ahead)
        right = np.cross(ahead, np.eye(3)[np.argmin(np.abs(ahead))])
        right /= np.linalg.norm(right)
        return place, np.stack([right, np.cross(ahead, right), ahead]), 1.001 * float(np.tan(light.cone[1]))


def fill(corners: np.ndarray, tall: float) -> tuple[np.ndarray, np.ndarray]:
    """Finds where the entries of each cell begin, int64 [SIDE^2], and the entries int32 [n, 2], of boxes with corners
    float64 [I, 8, 3] m in a light's axes; tall: tan of its cone's half angle."""
    ahead = corners[..., 2]
    near = ahead.min(1)
    crossing = (near <= 2 * BEFORE)[:, None]
    at = (corners[..., :2] / (tall * np.maximum(ahead, BEFORE)[..., None]) + 1) * (SIDE / 2)
    first = np.where(crossing, 0, np.floor(at.min(1) - 0.01))
    last = np.where(crossing, SIDE - 1, np.floor(at.max(1) + 0.01))
    which = np.flatnonzero((ahead.max(1) > BEFORE) & (first < SIDE).all(1) & (last >= 0).all(1))
    first, last = (np.clip(edge[which], 0, SIDE - 1).astype(np.int64) for edge in (first, last))
    wide, high = (last - first + 1).T
    count = wide * high
    n = np.repeat(np.arange(len(which)), count)
    k = np.arange(len(n)) - np.repeat(np.cumsum(count) - count, count)
    cell = (first[n, 1] + k // wide[n]) * SIDE + first[n, 0] + k % wide[n]
    # Rounded down, for it must not be more than it is.
    least = np.nextafter(near[which].astype(np.float32), np.float32(-np.inf))
    order = np.lexsort((n, least[n], cell))
    entries = np.stack([which[n[order]].astype(np.int32), least[n[order]].view(np.int32)], axis=-1)
    return np.searchsorted(cell[order], np.arange(SIDE * SIDE)), entries
