"""The raster: blocks of triangles culled against the field of view, then walked pixel by pixel.

A block is up to clusters.SIZE consecutive triangles (or vertices) of one instance with a bounding sphere and a cone of
normals. `lanes` threads share a block: one on a CPU, one per triangle on a GPU. Culling leaves out only what covers no
pixel, so it changes no bit of the result.
"""

import warp as wp

from nodes.renderer.distortion_kernels import make_bounds, walk_rays
from nodes.renderer.kernels import View, bounds, facing, outside, set_up, turned_away, walk

wp.set_module_options({"enable_backward": False})

SPLIT_AREA = wp.constant(512)
"""Bounding box [px] above which a triangle is split among threads."""

TILE = wp.constant(8)
"""Side [px] of the piece of a split triangle that one thread walks."""


@wp.struct
class Blocks:
    """Pieces [B] of the instances: items first..last - 1, bounding sphere and cone of normals in the instance's frame.

    cosine: of the cone's half angle; at most 0 where its back side must not be left out.
    """

    instance: wp.array(dtype=int)
    first: wp.array(dtype=int)
    last: wp.array(dtype=int)
    centre: wp.array(dtype=wp.vec3)
    radius: wp.array(dtype=float)
    extent: wp.array(dtype=float)
    """Radius of the whole instance's sphere, which is about its origin."""
    axis: wp.array(dtype=wp.vec3)
    cosine: wp.array(dtype=float)


@wp.kernel
def to_camera(
    # in
    view: View,
    block0: int,
    lanes: int,
    blocks: Blocks,
    points: wp.array(dtype=wp.vec3),
    rotation: wp.array2d(dtype=wp.mat33),
    translation: wp.array2d(dtype=wp.vec3),
    # out
    vertices: wp.array2d(dtype=wp.vec3),
):
    """Vertices of the instances that may be seen."""
    env, block, lane = wp.tid()
    b = block0 + block
    i = blocks.instance[b]
    r = rotation[env, i]
    t = translation[env, i]
    if not outside(view, 0, view.height, t, blocks.extent[b]):
        for v in range(blocks.first[b] + lane, blocks.last[b], lanes):
            vertices[env, v] = r * points[v] + t


def make_raster(split: bool, lens: str) -> wp.Kernel:
    """One thread per block and lane. split: triangles above SPLIT_AREA go to a list for `raster_tiles`. lens: `none` or
    a distortion model."""
    bounds_of = make_bounds(lens) if lens != "none" else bounds
    walk_over = walk_rays if lens != "none" else walk

    @wp.kernel(module="unique", enable_backward=False)
    def raster(
        # in
        view: View,
        row0: int,
        row1: int,
        block0: int,
        lanes: int,
        blocks: Blocks,
        two_sided: wp.array(dtype=int),
        rotation: wp.array2d(dtype=wp.mat33),
        translation: wp.array2d(dtype=wp.vec3),
        vertices: wp.array2d(dtype=wp.vec3),
        triangles: wp.array(dtype=wp.vec3i),
        # out
        packed: wp.array3d(dtype=wp.uint64),
        counter: wp.array(dtype=wp.uint64),
        large: wp.array(dtype=wp.vec2i),
        large_start: wp.array(dtype=wp.int64),
    ):
        env, block, lane = wp.tid()
        n = block0 + block
        i = blocks.instance[n]
        turn = rotation[env, i]
        place = turn * blocks.centre[n] + translation[env, i]
        if outside(view, row0, row1, place, blocks.radius[n]):
            return
        # The vertices of an instance that is outside as a whole are not there, though a block's sphere may stick out.
        if outside(view, 0, view.height, translation[env, i], blocks.extent[n]):
            return
        if turned_away(turn * blocks.axis[n], blocks.cosine[n], place, blocks.radius[n]):
            return
        sides = two_sided[i]
        for t in range(blocks.first[n] + lane, blocks.last[n], lanes):
            k = triangles[t]
            a = vertices[env, k[0]]
            b = vertices[env, k[1]]
            c = vertices[env, k[2]]
            if facing(a, b, c, sides) and (view.distorted == 1 or wp.max(a[2], wp.max(b[2], c[2])) >= view.near):
                s = set_up(view, a, b, c, bounds_of(view, a, b, c))
                y0 = wp.max(s.y0, row0)
                y1 = wp.min(s.y1, row1 - 1)
                if s.x1 >= s.x0 and y1 >= y0:
                    kept = wp.bool(True)
                    if wp.static(split):
                        if (s.x1 - s.x0 + 1) * (y1 - y0 + 1) > SPLIT_AREA:
                            kept = wp.bool(False)
                            tiles = ((s.x1 - s.x0) // TILE + 1) * ((s.y1 - s.y0) // TILE + 1)
                            # One 64-bit counter gives a place in the list and the number of tiles before it at once.
                            old = wp.atomic_add(counter, 0, (wp.uint64(1) << wp.uint64(40)) | wp.uint64(tiles))
                            at = int(old >> wp.uint64(40))
                            large[at] = wp.vec2i(env, t)
                            large_start[at] = wp.int64(old & wp.uint64(0xFFFFFFFFFF))
                    if kept:
                        walk_over(view, s, s.x0, s.x1, y0, y1, env, t, packed)

    return raster


def make_raster_tiles(lens: str) -> wp.Kernel:
    """The tiles of the triangles that `raster` has listed, shared evenly among `workers` threads."""
    bounds_of = make_bounds(lens) if lens != "none" else bounds
    walk_over = walk_rays if lens != "none" else walk

    @wp.kernel(module="unique", enable_backward=False)
    def raster_tiles(
        # in
        view: View,
        workers: int,
        vertices: wp.array2d(dtype=wp.vec3),
        triangles: wp.array(dtype=wp.vec3i),
        counter: wp.array(dtype=wp.uint64),
        large: wp.array(dtype=wp.vec2i),
        large_start: wp.array(dtype=wp.int64),
        # out
        packed: wp.array3d(dtype=wp.uint64),
    ):
        worker = wp.tid()
        count = int(counter[0] >> wp.uint64(40))
        total = wp.int64(counter[0] & wp.uint64(0xFFFFFFFFFF))
        tile = wp.int64(worker)
        while tile < total:
            low = wp.int32(0)
            high = int(count)
            while high - low > 1:
                middle = (low + high) // 2
                if large_start[middle] <= tile:
                    low = middle
                else:
                    high = middle
            env = large[low][0]
            t = large[low][1]
            k = triangles[t]
            a = vertices[env, k[0]]
            b = vertices[env, k[1]]
            c = vertices[env, k[2]]
            s = set_up(view, a, b, c, bounds_of(view, a, b, c))
            columns = (s.x1 - s.x0) // TILE + 1
            index = int(tile - large_start[low])
            x0 = s.x0 + index % columns * TILE
            y0 = s.y0 + index // columns * TILE
            walk_over(view, s, x0, wp.min(x0 + TILE - 1, s.x1), y0, wp.min(y0 + TILE - 1, s.y1), env, t, packed)
            tile += wp.int64(workers)

    return raster_tiles
