"""Computes visibility between sub-frames that are near each other: only of what is seen in either, in scenes of many
triangles.

Where the image of the world moves by less than a pixel from one sub-frame to the next, the raster draws all blocks of
triangles at every n-th sub-frame, and at the others those of which anything was seen at one of these lately, and all
that moves by itself. Silhouettes are as exact as ever; a block that comes and goes between two full sub-frames is
missed.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

from evis.geometry import se3
from nodes.interpolator.rigid.sampling import pixels_per_radian
from nodes.renderer.raster import raster_kernels
from nodes.renderer.raster.entries import triangles_of
from nodes.renderer.raster.raster import RowRaster, make_raster
from nodes.renderer.raster.visibility import Visibility

FIELDS: dict[str, Any] = {
    "instance": wp.int32, "first": wp.int32, "last": wp.int32, "centre": wp.vec3, "radius": wp.float32,
    "extent": wp.float32, "axis": wp.vec3, "cosine": wp.float32,
}  # fmt: skip
"""Arrays of raster_kernels.Blocks."""
MANY = 1024
"""Blocks of what stands still from which on this saves more than it costs."""
LONGEST = 8
"""Most sub-frames from one that is drawn in full to the next."""
LATELY = 12
"""Full sub-frames for which a block is drawn after it was seen."""
GRID = 16
"""Pixels between those at which the motion is looked at."""
MOSTLY = 0.9
"""Share of the image that is to move by less than is allowed."""


class SparseRaster:
    """Draws the slots of a visibility, each of `envs` environments."""

    def __init__(self, visibility: Visibility, envs: int, step_px: float) -> None:
        """Takes the z-buffer that is drawn into. step_px: path [px] from one sub-frame that is drawn in full to the
        next."""
        v = self._v = visibility
        assert isinstance(v.raster, RowRaster)
        self._blocks, self._raster = v.raster.blocks, make_raster(v.lens)
        self._envs, self._step = envs, step_px
        self._triangles, self._points = ({n: getattr(b, n).numpy() for n in FIELDS} for b in self._blocks)
        still = v.geometry.static[self._triangles["instance"]]
        self._block = np.zeros(len(v.geometry.triangles), np.int32)
        for block, (first, last) in enumerate(zip(self._triangles["first"], self._triangles["last"])):
            self._block[first:last] = block
        self._seen = np.tile(np.where(still, -LATELY - 1, 1 << 30), (envs, 1))
        """Which of an environment's full sub-frames was the last to see a block."""
        self._full = [0] * envs
        self.settle()
        gain = pixels_per_radian(v)
        self._gain = gain if gain > 0 else float(max(v.view.fx, v.view.fy))
        y, x = np.mgrid[GRID // 2 : v.shape[1] : GRID, GRID // 2 : v.shape[2] : GRID]
        self._grid = y.ravel(), x.ravel()
        if v.view.distorted:
            self._rays = v.view.rays.numpy()[self._grid].astype(np.float64)
        else:
            columns, rows = v.view.columns.numpy()[self._grid[1]], v.view.rows.numpy()[self._grid[0]]
            self._rays = np.stack([columns, rows, np.ones(len(rows))], axis=-1).astype(np.float64)

    @staticmethod
    def pays(v: Visibility) -> bool:
        """Tells whether there is enough that stands still, and is not kept as a layer."""
        if v.layered or not isinstance(v.raster, RowRaster):
            return False
        return int(v.geometry.static[v.raster.blocks[0].instance.numpy()].sum()) >= MANY

    def settle(self) -> None:
        """Keeps what was seen so far as the knowledge at the start of every episode."""
        self._seen_first, self._full_first = self._seen.copy(), list(self._full)

    def begin(self, env: int) -> None:
        """Forgets what was seen in an environment, whose episode begins; `remember` its first keyframe next."""
        self._seen[env], self._full[env] = self._seen_first[env], self._full_first[env]

    def remember(self, env: int, packed: np.ndarray) -> None:
        """Remembers what is seen in an environment's z-buffer uint64 [H, W]."""
        triangles = triangles_of(packed)
        seen = np.unique(self._block[triangles[triangles >= 0]])
        self._seen[env, seen] = np.maximum(self._seen[env, seen], self._full[env])
        self._full[env] += 1

    def strides(self, eyes: np.ndarray, packed: wp.array) -> list[int]:
        """Gives sub-frames from one that is drawn in full to the next, for camera poses float64 [K + 1, E, 7] of a gap
        and the z-buffer [E, H, W] at the first of them: in each environment so many that most of the image moves by
        step_px at most."""
        away = (packed.numpy()[:, self._grid[0], self._grid[1]] >> np.uint64(32)).astype(np.uint32).view(np.float32)
        strides = []
        for env in range(eyes.shape[1]):
            near = np.isfinite(away[env])
            points = se3.transform(eyes[0, env], self._rays[near] * away[env, near, None])
            seen = se3.transform(se3.inverse(eyes[:, env])[:, None], points[None])
            seen /= np.maximum(np.linalg.norm(seen, axis=-1, keepdims=True), 1e-12)
            path = np.linalg.norm(np.diff(seen, axis=0), axis=-1).sum(0) * self._gain
            pace = float(np.quantile(path, MOSTLY)) / (len(eyes) - 1) if path.size else 0.0
            strides.append(int(np.clip(self._step / max(pace, 1e-9), 1, LONGEST)))
        return strides

    def draw_keyframe(self) -> None:
        """Draws the first slot of every environment in full, and remembers nothing."""
        v, envs = self._v, self._envs
        v.packed.view(wp.int64).fill_(-1)
        v.place_instances()
        for row in range(envs):
            self._add(slice(row, row + 1), self._blocks)

    def draw(
        self, first: int, count: int, strides: list[int], closed: bool, placed: Callable[[], None] = lambda: None
    ) -> None:
        """Draws the slots 0 .. first + count - 1; before `first` is keyframe B, or nothing. closed: B comes right after
        them. placed: called when the instances are where they are in these slots."""
        v, envs = self._v, self._envs
        v.packed.view(wp.int64).fill_(-1)
        v.place_instances()
        placed()
        for env, stride in enumerate(strides):
            after = [first + k for k in range(stride - 1, count, stride)]
            full = sorted({*range(first), *after, *([] if closed or not count else [first + count - 1])})
            for slot in full:
                row = slot * envs + env
                self._add(slice(row, row + 1), self._blocks)
                self.remember(env, v.packed[row].numpy())
            rest = sorted({*range(first + count)} - {*full})
            if rest:
                lately = self._lately(env)
                for start, stop in _runs(rest) if envs == 1 else [(k, k + 1) for k in rest]:
                    self._add(slice(start * envs + env, (stop - 1) * envs + env + 1), lately)

    def _add(self, part: slice, blocks: list[Any]) -> None:
        """Adds blocks of triangles to some environments of the z-buffer, from the blocks of vertices they need."""
        v, (triangles, points), envs = self._v, blocks, part.stop - part.start
        count, count_points = triangles.first.size, points.first.size
        if not count or envs <= 0:
            return
        place, vertices = [v.rotation[part], v.translation[part]], v.raster.vertices[part]
        inputs = [v.view, 0, points, v.points, *place, vertices]
        wp.launch(raster_kernels.to_camera, dim=(envs, count_points), inputs=inputs, device=v.device)
        shared = [0, triangles, v.two_sided, *place, vertices, v.triangles, v.packed[part]]
        v.row_tiles.launch(self._raster, lambda row0, row1: ((envs, count), [v.view, row0, row1, *shared]), v.device)

    def _lately(self, env: int) -> list[Any]:
        """Selects the blocks of triangles that were seen lately or move, and those of their vertices."""
        triangles = np.flatnonzero(self._seen[env] >= self._full[env] - LATELY)
        shown = np.zeros(len(self._v.geometry.body), bool)
        shown[self._triangles["instance"][triangles]] = True
        points = np.flatnonzero(shown[self._points["instance"]])
        return [_some(self._triangles, triangles), _some(self._points, points)]


def _runs(numbers: list[int]) -> list[tuple[int, int]]:
    """Finds start and end of the runs of ascending numbers that follow each other."""
    cuts = [0, *(k for k in range(1, len(numbers)) if numbers[k] != numbers[k - 1] + 1), len(numbers)]
    return [(numbers[a], numbers[b - 1] + 1) for a, b in pairwise(cuts)]


def _some(blocks: dict[str, np.ndarray], which: np.ndarray) -> Any:
    """Selects some blocks as the kernels read them, on a CPU."""
    chosen = raster_kernels.Blocks()
    for name, dtype in FIELDS.items():
        setattr(chosen, name, wp.array(blocks[name][which], dtype=dtype, device="cpu"))
    return chosen
