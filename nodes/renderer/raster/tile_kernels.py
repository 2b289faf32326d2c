"""Draws the tiles of large triangles, which `tiled_kernels.py` has listed: by a group of threads for each tile."""

from functools import cache

import warp as wp

from evis.gpu.reading_kernels import number, whole_four_in
from nodes.renderer.raster.lens.distortion_kernels import walk_rays
from nodes.renderer.raster.lens.view_kernels import CameraView
from nodes.renderer.raster.shuffle_kernels import first_above, running_sum, shuffle_from
from nodes.renderer.raster.tiled_kernels import LARGE, LARGE_REGIONS, LINE, TILE_BITS, WIDE
from nodes.renderer.raster.triangle_kernels import Setup, columns_of, cover, row_share, runs_of, stored_setup, walk

wp.set_module_options({"enable_backward": False})


@wp.func
def beside(e: wp.vec3, slack: float, left: float, right: float, top: float, bottom: float):
    """Tells whether an edge has all of a tile outside: the pixel that lies most inside, by the sums that walking
    takes."""
    x = wp.where(e[0] > 0.0, right, left)
    y = wp.where(e[1] > 0.0, bottom, top)
    return e[0] * x + (e[1] * y + e[2] + slack) < 0.0


@wp.func
def missed(view: CameraView, s: Setup, x0: int, x1: int, y0: int, y1: int):
    """Tells whether a triangle of a pinhole's image leaves out all of a tile, which is so for most tiles of a thin
    one."""
    left = number(view.columns, x0)
    right = number(view.columns, x1)
    top = number(view.rows, y0)
    bottom = number(view.rows, y1)
    return (
        beside(s.e0, s.slack[0], left, right, top, bottom)
        or beside(s.e1, s.slack[1], left, right, top, bottom)
        or beside(s.e2, s.slack[2], left, right, top, bottom)
    )


@cache
def make_walk_tile(rows: int) -> wp.Function:
    """Makes the function `walk_tile` for tiles of so many rows, 8, 16 or 32."""

    @wp.func
    def walk_tile(
        view: CameraView,
        s: Setup,
        x0: int,
        x1: int,
        y0: int,
        y1: int,
        lane: int,
        env: int,
        face: int,
        packed: wp.array3d(dtype=wp.uint64),
    ):
        """Walks a tile by a group of threads: each finds the columns of its row, then all share the pixels of all
        rows."""
        columns = wp.vec2i(0, -1)
        if y0 + lane <= y1:
            r = row_share(view, s, y0 + lane)
            columns = columns_of(runs_of(view, s, x0, x1), r, view.cx + float(view.margin), x0, x1)
        length = columns[1] - columns[0] + 1
        end = running_sum(length, wp.static(rows))
        # Where a row's pixel 0 would be if it began with the first pixel of all.
        origin = columns[0] - (end - length)
        total = shuffle_from(end, wp.static(rows) - 1, wp.static(rows))
        for start in range(0, total, wp.static(rows)):
            pixel = start + lane
            row = first_above(pixel, end, wp.static(rows))
            x = pixel + shuffle_from(origin, row, wp.static(rows))
            if pixel < total:
                cover(view, s, row_share(view, s, y0 + row), x, y0 + row, env, face, packed)

    return walk_tile


def make_tiles(lens: str, rows: int, together: bool) -> wp.Kernel:
    """Makes the kernel `raster_tiles`.

    rows: of a tile, and threads that share it, 8, 16 or 32. together: these run together and share its pixels; for a
    pinhole on a GPU.
    """
    walk_row = walk_rays if lens != "none" else walk
    walk_tile = make_walk_tile(rows)

    @wp.kernel(module="unique", enable_backward=False)
    def raster_tiles(
        # in
        view: CameraView,
        workers: int,
        counters: wp.array(dtype=int),
        large: wp.array2d(dtype=wp.vec4i),
        setups: wp.array3d(dtype=wp.vec4),
        # out
        packed: wp.array3d(dtype=wp.uint64),
    ):
        """Draws the tiles of large triangles, a thread for each row.

        Args:
            workers: threads that share the list.
            counters, large, setups, packed: as of `raster`.
        """
        tid = wp.tid()
        region = (tid // wp.static(rows)) % LARGE_REGIONS
        at = tid // (wp.static(rows) * LARGE_REGIONS)
        count = wp.min(counters[(LARGE + region) * LINE], large.shape[1])
        while at < count:
            tile = whole_four_in(large, region * large.shape[1] + at)
            env = tile[0]
            face = tile[1]
            if face >= 0:
                s = stored_setup(setups, region, tile[3])
                x0 = s.x0 + (tile[2] & ((1 << TILE_BITS) - 1)) * WIDE
                x1 = wp.min(x0 + WIDE - 1, s.x1)
                y0 = s.y0 + ((tile[2] >> TILE_BITS) & ((1 << TILE_BITS) - 1)) * wp.static(rows)
                y1 = wp.min(y0 + wp.static(rows) - 1, s.y1)
                y = y0 + tid % wp.static(rows)
                if wp.static(together):
                    if not missed(view, s, x0, x1, y0, y1):
                        walk_tile(view, s, x0, x1, y0, y1, tid % wp.static(rows), env, face, packed)
                elif y <= y1:
                    walk_row(view, s, x0, x1, y, y, env, face, packed)
            at += workers // (wp.static(rows) * LARGE_REGIONS)

    return raster_tiles
