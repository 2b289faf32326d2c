"""Draws a scene's triangles into a z-buffer in two ways with the same result: by rows on a CPU, by lists on a GPU."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
import warp as wp

from evis.gpu.building import LAUNCH_BLOCK
from nodes.renderer.raster import clusters, raster_kernels, tile_kernels, tiled_kernels
from nodes.renderer.raster.scene_arrays import SceneArrays
from nodes.renderer.raster.triangle_kernels import SETUP_QUADS

WORKERS = 1 << 20
"""Threads that share a list: more than run at once, so that who has done his is followed by another."""

TILE_BLOCK = 64
"""Threads of a block that draws tiles: few, for a block makes room only when all of it is done."""

FEW = 1 << 14
"""Blocks up to which they are drawn without a list of what may be seen."""

ROWS = {True: 32, False: 8}
"""Rows of a tile where blocks are few, and it counts how long one takes, and many, where no thread should be idle."""

LARGE_IMAGE = 1 << 16
"""Pixels from which triangles are large enough for tiles of many rows in any case."""

SPLIT_AREA = {True: 16, False: 32}
"""Bounding box [px] above which a triangle is cut into tiles, by the same: who walks many holds up its neighbours."""

SHARED_AREA = 64
"""The same where threads share the pixels of a tile, which pays for many large images: one waits for its slowest."""

AT_ONCE = 1 << 25
"""Most triangles that are gone through at once; more environments than have so many take turns."""

MOST_TILES = 1 << 22
"""Tiles that there is room for in all; more environments than have room take turns."""

make_raster = cache(raster_kernels.make_raster)
make_listed = cache(tiled_kernels.make_listed)
make_at_once = cache(tiled_kernels.make_at_once)
make_tiles = cache(tile_kernels.make_tiles)


class RowRaster:
    """Turns corners to the camera once; then every thread draws all triangles into the rows that it owns."""

    local = False

    def __init__(self, arrays: SceneArrays, still: np.ndarray) -> None:
        """Takes the scene. still: bool [I], instances that stand still before a still camera; they are drawn apart."""
        v = self._v = arrays
        pieces = clusters.triangle_blocks(v.geometry, still, v.sides), clusters.vertex_blocks(v.geometry, still)
        self.blocks = [put_blocks(p, v.put) for p in pieces]
        self._sizes = [(p.still, len(p.instance)) for p in pieces]
        self.vertices = v.empty((v.envs, len(v.geometry.vertices)), wp.vec3)
        self._raster = make_raster(v.lens)
        self.kernels = [(self._raster, LAUNCH_BLOCK), (raster_kernels.to_camera, LAUNCH_BLOCK)]
        """As `build_together` takes them."""

    def clear(self) -> None:
        """Does nothing: there are no lists to empty."""

    def draw(self, packed: wp.array, still: bool, moving: bool, cleared: Callable[[], None] = lambda: None) -> None:
        """Adds the still blocks, the others, or both to a z-buffer, after `cleared` has been called."""
        cleared()
        v = self._v
        blocks, points = self.blocks
        (start, count), (start_points, count_points) = (part_of(*sizes, still, moving) for sizes in self._sizes)
        if not count:
            return
        place = [v.rotation, v.translation]
        inputs = [v.view, start_points, points, v.points, *place, self.vertices]
        wp.launch(raster_kernels.to_camera, dim=(v.envs, count_points), inputs=inputs, device=v.device)
        shared = [start, blocks, v.two_sided, *place, self.vertices, v.triangles, packed]
        v.row_tiles.launch(self._raster, lambda row0, row1: ((v.envs, count), [v.view, row0, row1, *shared]), v.device)


class TiledRaster:
    """Draws by lists of what may be seen, made step by step, which threads share; see tiled_kernels."""

    local = True

    def __init__(self, arrays: SceneArrays, still: np.ndarray) -> None:
        """Takes the scene. still: bool [I], instances that stand still before a still camera; they are drawn apart."""
        v = self._v = arrays
        pieces = clusters.triangle_blocks(v.geometry, still, v.sides)
        self._blocks, self._still, self._count = put_blocks(pieces, v.put), pieces.still, len(pieces.instance)
        self.vertices = v.points.reshape((1, -1))
        self._counters = wp.zeros(tiled_kernels.COUNTERS * int(tiled_kernels.LINE), dtype=wp.int32, device=v.device)
        threads, regions = int(tiled_kernels.BLOCK_THREADS), int(tiled_kernels.SMALL_REGIONS)
        # A warehouse of 200,000 triangles takes a tile for every second pixel, of 8 rows; of 32, for every sixth.
        pixels = v.shape[1] * v.shape[2]
        room = min(2 * len(v.geometry.triangles), pixels // 2)
        at_once = min(AT_ONCE // max(1, self._count * threads), MOST_TILES // max(1, room))
        self._envs = min(v.envs, max(1, at_once))
        listed = self._envs * self._count
        self._few = listed <= FEW
        if not self._few:
            self._listed = v.empty(listed, wp.vec4i)
            self._small = v.empty((regions, -(-listed // regions) * threads), wp.vec2i)
        rows = ROWS[self._few or pixels > LARGE_IMAGE]
        # Room for a few triangles as large as the image in any case.
        regions = int(tiled_kernels.LARGE_REGIONS)
        full = (v.shape[2] // int(tiled_kernels.WIDE) + 1) * (v.shape[1] // rows + 1)
        places = self._envs * room // regions + 4 * full
        self._large = v.empty((regions, places), wp.vec4i)
        self._setups = v.empty((regions, places, int(SETUP_QUADS)), wp.vec4)
        together = v.device.is_cuda and v.lens == "none" and not self._few and pixels > LARGE_IMAGE
        area = SHARED_AREA if together else SPLIT_AREA[self._few]
        if self._few:
            self._at_once = make_at_once(v.lens, area, rows)
        else:
            self._list, self._raster = make_listed(v.lens, area, rows)
        self._tiles = make_tiles(v.lens, rows, together)
        before = [self._at_once] if self._few else [self._list, self._raster, tiled_kernels.list_blocks]
        self.kernels = [(self._tiles, TILE_BLOCK), *((kernel, LAUNCH_BLOCK) for kernel in before)]
        """As `build_together` takes them."""
        self._cleared = False

    def clear(self) -> None:
        """Empties the lists, which may be done before `draw`, beside other things."""
        self._counters.zero_()
        self._cleared = True

    def draw(self, packed: wp.array, still: bool, moving: bool, cleared: Callable[[], None] = lambda: None) -> None:
        """Adds the still blocks, the others, or both to a z-buffer, after `cleared` has been called."""
        start, count = part_of(self._still, self._count, still, moving)
        if count:
            for first in range(0, self._v.envs, self._envs):
                self._draw(packed, start, count, first, min(self._envs, self._v.envs - first), cleared)

    def _draw(
        self, packed: wp.array, start: int, count: int, first: int, envs: int, cleared: Callable[[], None]
    ) -> None:
        v, counters = self._v, self._counters
        place = [v.rotation, v.translation]
        corners = [*place, self.vertices, v.triangles]
        large = [counters, self._large, self._setups, packed]
        workers = min(WORKERS, envs * count * int(tiled_kernels.BLOCK_THREADS))
        cleared()
        if not self._cleared:
            counters.zero_()
        self._cleared = False
        if self._few:
            inputs = [v.view, workers, first, envs, start, count, self._blocks, v.two_sided, *corners]
            wp.launch(self._at_once, dim=workers, inputs=[*inputs, *large], device=v.device)
        else:
            inputs = [v.view, first, start, self._blocks, *place, counters, self._listed]
            wp.launch(tiled_kernels.list_blocks, dim=(envs, count), inputs=inputs, device=v.device)
            inputs = [v.view, workers, v.two_sided, *corners, self._listed, counters, self._small]
            wp.launch(self._list, dim=workers, inputs=inputs, device=v.device)
            inputs = [v.view, WORKERS, v.triangle_instance, *corners, self._small, *large]
            wp.launch(self._raster, dim=WORKERS, inputs=inputs, device=v.device)
        wp.launch(self._tiles, WORKERS, [v.view, WORKERS, *large], device=v.device, block_dim=TILE_BLOCK)


class NoRaster:
    """Draws nothing, for a caller that finds by itself what the pixels show."""

    local = True
    kernels: Sequence[tuple[wp.Kernel, int]] = ()

    def __init__(self, arrays: SceneArrays, still: np.ndarray) -> None:
        """Takes what all rasters take; `still` is not read, for nothing is drawn apart."""
        self.vertices = arrays.points.reshape((1, -1))

    def clear(self) -> None:
        """Does nothing."""

    def draw(self, packed: wp.array, still: bool, moving: bool, cleared: Callable[[], None] = lambda: None) -> None:
        """Does nothing but call `cleared`."""
        cleared()


def part_of(first_moving: int, count: int, still: bool, moving: bool) -> tuple[int, int]:
    """Gives the start and the number of the still items, which come first, of the others, or of both."""
    start = 0 if still else first_moving
    return start, (count if moving else first_moving) - start


def put_blocks(blocks: clusters.Blocks, put: Any) -> Any:
    """Gives blocks on the device. put: as SceneArrays.put."""
    there = raster_kernels.Blocks()
    for name in ("instance", "first", "last"):
        setattr(there, name, put(getattr(blocks, name), wp.int32))
    there.centre, there.axis = put(blocks.centre, wp.vec3), put(blocks.axis, wp.vec3)
    for name in ("radius", "extent", "cosine"):
        setattr(there, name, put(getattr(blocks, name), wp.float32))
    return there
