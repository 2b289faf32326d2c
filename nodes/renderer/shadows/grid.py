"""Builds the grids of lights without size that stand still, see grid_kernels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from evis.geometry import se3
from evis.gpu.building import LAUNCH_BLOCK
from evis.scene.model import Light
from nodes.renderer.geometry.triangles import is_static
from nodes.renderer.shadows import grid_kernels, occlusion_kernels
from nodes.renderer.shadows.boxes import half_extents
from nodes.renderer.shadows.occlusion import TREE_FROM

if TYPE_CHECKING:
    from nodes.renderer.raster.visibility import Visibility
    from nodes.renderer.shadows.occlusion import Occluders

WIDEST = np.deg2rad(80.0)
"""Half angle of a cone up to which it has a grid, which lies in a plane before the light."""

SLACK = 1e-4
"""How much wider the boxes in a grid are than what is in them, of the size of the scene: rays are this much beside the
line through the light that tells their cell, and more only from places ten times as far away as the scene is large."""

BEYOND = 4.0
"""Distance from the middle of a scene to the plane that a directional light comes from, of the scene's size."""

SIDE, COARSE, CUBE = int(grid_kernels.SIDE), int(grid_kernels.COARSE), int(grid_kernels.CUBE)
BEFORE = float(grid_kernels.BEFORE)
PAIRS = np.triu_indices(8, 1)
"""Any two of a box's corners."""
EDGES = np.array([(i, i + step) for step in (1, 2, 4) for i in range(8) if not i & step]).T
"""The two corners of each edge of a box."""
SIGNS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)


@dataclass(frozen=True)
class Face:
    """Holds where one grid is: place [3] m and axes [3, 3] (right, down, ahead); tall: tan of the half angle of what it
    sees, or half of its width [m] where it is parallel."""

    place: np.ndarray
    axes: np.ndarray
    tall: float
    parallel: bool = False


@dataclass(frozen=True)
class Laid:
    """Holds what the kernels' grids have of the scene; see grid_kernels.Grid, whose places are about `middle` [3] m of
    the world. size: from there to the farthest box [m]; tall: as of each Face."""

    middle: np.ndarray
    size: float
    lower: np.ndarray
    upper: np.ndarray
    place: np.ndarray
    axes: np.ndarray
    tall: np.ndarray
    parallel: np.ndarray
    cells: np.ndarray
    entries: np.ndarray


class ShadowGrid:
    """Makes `kernel` (grid_kernels.Grid) of some lights; `place` it for every new instant."""

    def __init__(self, visibility: Visibility, occluders: Occluders, lights: list[int]) -> None:
        """Makes the grids of a scene. lights: those that `suits` is true of."""
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
        faces = np.array([CUBE if v.scene.lights[light].kind == "point" else 1 for light in lights])
        self._grids = int(faces.sum())
        of = np.full(len(v.scene.lights), -1, np.int32)
        of[lights] = np.arange(len(lights))
        grid.of = v.put(of, wp.int32)
        grid.faces, grid.first = v.put(faces, wp.int32), v.put(np.cumsum(faces) - faces, wp.int32)
        grid.masks = wp.zeros((v.envs, self._grids, COARSE * COARSE), dtype=wp.uint64, device=v.device)

    @property
    def kernels(self) -> list[tuple[wp.Kernel, int]]:
        """Gives the kernel that `place` launches besides those of the occluders, as `build_together` takes it."""
        return [(grid_kernels.mark_movers, LAUNCH_BLOCK)] if self._moving else []

    @staticmethod
    def suits(visibility: Visibility, occluders: Occluders, light: int) -> bool:
        """Tells whether a light can have a grid, and there is so much that it pays."""
        casters, given = occluders.casters, visibility.scene.lights[light]
        moving = casters.order.size - casters.still
        many = occluders.trees and casters.still >= TREE_FROM and moving <= int(grid_kernels.MOVERS)
        narrow = given.kind in ("directional", "point") or (given.kind == "spot" and given.cone[1] <= WIDEST)
        return many and narrow and is_static(visibility.scene, given.body)

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
            dim = (v.envs, self._grids, self._moving)
            wp.launch(grid_kernels.mark_movers, dim, [self._occluders.casters], [grid], device=v.device)

    def _build(self) -> None:
        """Takes the grids for where the still instances and the lights are."""
        v, grid, last = self._v, self.kernel, self._v.last
        assert last is not None
        bodies = {int(body) for body in v.geometry.body[self._still]}
        bodies |= {v.scene.lights[light].body for light in self._lights}
        at = last[0, sorted(body for body in bodies if body >= 0)]
        # Who else sees the scene in this process needs the same.
        key = "shadow grid", self._still.tobytes(), tuple(self._lights), at.tobytes()
        laid: Laid = v.geometry.once(key, lambda: self._lay(last))
        self._middle, self._size = laid.middle, laid.size
        grid.slack = SLACK * laid.size
        grid.lower, grid.upper = v.put(laid.lower, wp.vec3), v.put(laid.upper, wp.vec3)
        grid.place, grid.scale = v.put(laid.place, wp.vec3), v.put(1 / laid.tall, wp.float32)
        grid.parallel = v.put(laid.parallel, wp.int32)
        grid.right, grid.down, grid.ahead = (v.put(laid.axes[:, k], wp.vec3) for k in range(3))
        grid.cells, grid.entries = v.put(laid.cells, wp.int32), v.put(laid.entries, wp.vec2i)

    def _lay(self, poses: np.ndarray) -> Laid:
        """Finds boxes, cells and entries for poses of all bodies, float64 [E, N, 7]."""
        frames = self._v.instance_poses(poses)
        rotation, translation = frames.body(-1)
        to_world = np.swapaxes(rotation[0], -1, -2)
        turn = to_world @ frames.rotation[0, self._still]
        # In the world, then about the middle of all.
        centre = (frames.translation[0, self._still] - translation[0]) @ to_world.T
        middle = (centre.min(0) + centre.max(0)) / 2
        centre = centre - middle
        extent = (np.abs(turn) @ self._half[:, :, None])[..., 0]
        size = float((np.abs(centre) + extent).max())
        slack = SLACK * size
        corners = centre[:, None] + np.einsum("nij,nkj->nki", turn, SIGNS * (self._half + slack)[:, None])
        spread = float(np.linalg.norm(corners, axis=-1).max()) or 1.0
        faces = [face for light in self._lights for face in self._faces(light, poses, middle, spread)]
        parts = [fill((corners - f.place) @ f.axes.T, f.tall, f.parallel, slack) for f in faces]
        count = np.cumsum([0, *(len(entries) for _, entries in parts)])
        everybody = np.zeros((len(self._still), 2), np.int32)
        everybody[:, 0] = np.arange(len(self._still))
        starts = [*(starts + n for (starts, _), n in zip(parts, count)), [count[-1], count[-1] + len(everybody)]]
        place, axes, tall = (np.array([getattr(face, name) for face in faces]) for name in ("place", "axes", "tall"))
        return Laid(
            middle,
            size,
            centre - (extent + 2 * slack),
            centre + (extent + 2 * slack),
            place,
            axes,
            tall,
            np.array([face.parallel for face in faces], np.int32),
            np.concatenate(starts).astype(np.int32),
            np.concatenate([*(entries for _, entries in parts), everybody]),
        )

    def _faces(self, index: int, poses: np.ndarray, middle: np.ndarray, spread: float) -> list[Face]:
        """Gives where the grids of a light are, about the middle of the scene. poses: of all bodies, float64 [E, N, 7].
        spread: from the middle to the farthest corner [m]."""
        light = self._v.scene.lights[index]
        pose = poses[0, light.body] if light.body >= 0 else None
        if light.kind == "directional":
            ahead = np.asarray(light.vector, np.float64)
            if pose is not None:
                ahead = se3.transform(pose, ahead) - se3.transform(pose, np.zeros(3))
            axes = axes_along(ahead)
            return [Face(-BEYOND * spread * axes[2], axes, 1.001 * spread, True)]
        place = _placed(light, pose) - middle
        if light.kind == "point":
            return [Face(place, axes_along(sign * axis), 1.001) for axis in np.eye(3) for sign in (1, -1)]
        tip = _placed(light, pose, np.asarray(light.direction, np.float64)) - middle
        # A bit more than the cone, for rounding.
        return [Face(place, axes_along(tip - place), 1.001 * float(np.tan(light.cone[1])))]


def _placed(light: Light, pose: np.ndarray | None, beside: np.ndarray | float = 0.0) -> np.ndarray:
    """Computes a light's place, or one beside it, in the world [m]."""
    place = np.asarray(light.vector, np.float64) + beside
    return place if pose is None else se3.transform(pose, place)


def axes_along(ahead: np.ndarray) -> np.ndarray:
    """Makes unit vectors to the right, down and ahead, float64 [3, 3]."""
    ahead = ahead / np.linalg.norm(ahead)
    right = np.cross(ahead, np.eye(3)[np.argmin(np.abs(ahead))])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(ahead, right), ahead])


def seen_range(corners: np.ndarray, tall: float, slack: float) -> tuple[np.ndarray, np.ndarray]:
    """Finds within what columns and rows a light sees boxes, each from -1 to 1 over its grid, float64 [I, 2] twice.

    corners: float64 [I, 8, 3] m in the light's axes. tall: tan of the half angle that it sees. slack: how far a ray may
    be beside the line through the light [m]. What comes so near to the light that any ray may meet it has all of the
    grid; of what lies ahead of it in part, only that part counts.
    """
    ahead = corners[..., 2]
    low, high = corners.min(1), corners.max(1)
    near = tall * BEFORE + slack
    beside = (low[:, :2] > near).any(1) | (high[:, :2] < -near).any(1)
    anywhere = (low[:, 2] <= BEFORE) & (high[:, 2] >= -slack) & ~beside
    at = corners[..., :2] / (tall * np.maximum(ahead, BEFORE)[..., None])
    behind = (ahead < BEFORE)[..., None]
    first, last = np.where(behind, np.inf, at).min(1), np.where(behind, -np.inf, at).max(1)
    cut = np.flatnonzero((low[:, 2] < BEFORE) & (high[:, 2] > BEFORE))
    # Where the lines between corners on either side of the plane at BEFORE go through it.
    a, b = corners[cut][:, PAIRS[0]], corners[cut][:, PAIRS[1]]
    through = ((a[..., 2] < BEFORE) != (b[..., 2] < BEFORE))[..., None]
    step = np.where(through[..., 0], b[..., 2] - a[..., 2], 1.0)[..., None]
    met = (a + (BEFORE - a[..., 2:]) / step * (b - a))[..., :2] / (tall * BEFORE)
    first[cut] = np.minimum(first[cut], np.where(through, met, np.inf).min(1))
    last[cut] = np.maximum(last[cut], np.where(through, met, -np.inf).max(1))
    first[anywhere], last[anywhere] = -1.0, 1.0
    return first, last


def fill(corners: np.ndarray, tall: float, parallel: bool, slack: float) -> tuple[np.ndarray, np.ndarray]:
    """Finds where the entries of each cell begin, int64 [SIDE^2], and the entries int32 [n, 2], of boxes with corners
    float64 [I, 8, 3] m in a grid's axes; tall, parallel: of the grid; slack: as of `seen_range`."""
    if parallel:
        first, last = corners[..., :2].min(1) / tall, corners[..., :2].max(1) / tall
    else:
        first, last = seen_range(corners, tall, slack)
    lines = outlines(corners, tall, parallel)
    first, last = np.floor((first + 1) * (SIDE / 2) - 0.01), np.floor((last + 1) * (SIDE / 2) + 0.01)
    which = np.flatnonzero((first < SIDE).all(1) & (last >= 0).all(1))
    first, last = (np.clip(edge[which], 0, SIDE - 1).astype(np.int64) for edge in (first, last))
    wide, high = (last - first + 1).T
    count = wide * high
    n = np.repeat(np.arange(len(which)), count)
    k = np.arange(len(n)) - np.repeat(np.cumsum(count) - count, count)
    place = np.stack([first[n, 0] + k % wide[n], first[n, 1] + k // wide[n]], axis=-1)
    kept = touched(lines[which], n, place)
    n, cell = n[kept], place[kept, 1] * SIDE + place[kept, 0]
    # Rounded down, for it must not be more than it is.
    least = np.nextafter(corners[which][..., 2].min(1).astype(np.float32), np.float32(-np.inf))
    order = np.lexsort((n, least[n], cell))
    entries = np.stack([which[n[order]].astype(np.int32), least[n[order]].view(np.int32)], axis=-1)
    return np.searchsorted(cell[order], np.arange(SIDE * SIDE)), entries


def outlines(corners: np.ndarray, tall: float, parallel: bool) -> np.ndarray:
    """Finds the lines along the edges of boxes that have all of a box on one side, as a light sees it: float64
    [I, 12, 3], (a, b, c) of a x + b y + c >= 0 within, x and y from -1 to 1 over the grid; 0 for other edges, and for
    boxes that do not lie wholly ahead of the light. Arguments as of `fill`."""
    ahead = corners[..., 2:]
    at = corners[..., :2] / (tall if parallel else tall * np.maximum(ahead, BEFORE))
    start, way = at[:, EDGES[0]], at[:, EDGES[1]] - at[:, EDGES[0]]
    normal = np.stack([-way[..., 1], way[..., 0]], axis=-1)
    beyond = np.einsum("nek,nck->nec", normal, at) - np.einsum("nek,nek->ne", normal, start)[..., None]
    near = 1e-9 * np.abs(beyond).max(axis=-1)
    side = np.where(beyond.min(axis=-1) >= -near, 1.0, np.where(beyond.max(axis=-1) <= near, -1.0, 0.0))
    if not parallel:
        side *= np.all(ahead[..., 0] >= BEFORE, axis=1, keepdims=True)
    normal *= side[..., None]
    return np.concatenate([normal, -np.einsum("nek,nek->ne", normal, start)[..., None]], axis=-1)


def touched(lines: np.ndarray, n: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Finds which cells, by column and row `place` int [C, 2], may hold anything of box n [C]: the indices of those
    that do not lie outside any of its `lines` [I, 12, 3]."""
    kept = np.arange(len(n))
    # A hundredth of a cell more, for rounding.
    half = 1.02 / SIDE
    for edge in range(lines.shape[1]):
        a, b, c = lines[n[kept], edge].T
        x, y = ((place[kept, k] + 0.5) * (2 / SIDE) - 1 for k in range(2))
        kept = kept[a * x + b * y + c + half * (np.abs(a) + np.abs(b)) >= 0]
    return kept
