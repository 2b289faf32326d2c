"""Rasterises with thousands of threads: every step lists what the next one has to do, so that none waits for others.

Blocks that may be seen are listed, then their triangles that may cover a pixel, then the tiles of large ones; few
blocks are drawn at once, for a list takes longer than it saves. A fixed number of threads shares a
list, so that the host need not know how long it is. The places of a list are handed out by several counters, each for a
region of it and in a cache line of its own, for one line alone would be waited for. Corners are turned to the camera
where they are needed: reading them for every environment would cost more.
"""

from functools import cache

import warp as wp

from evis.gpu.reading_kernels import matrix_at, vector_at, whole_four
from nodes.renderer.raster.bounds_kernels import bounds, facing, holds_pixel
from nodes.renderer.raster.depth_kernels import face_from
from nodes.renderer.raster.lens.distortion_kernels import make_bounds, walk_rays
from nodes.renderer.raster.lens.view_kernels import CameraView
from nodes.renderer.raster.raster_kernels import Blocks, before_near, unseen
from nodes.renderer.raster.triangle_kernels import corners_of, set_up, store_setup, walk_all

wp.set_module_options({"enable_backward": False})

BLOCK_THREADS = wp.constant(64)
"""Threads that share a block: one for each of its triangles."""

GROUP = wp.constant(32)
"""Threads that share a region of the list of triangles at a time."""

WIDE = wp.constant(64)
"""Columns of a tile."""

SMALL_REGIONS = wp.constant(256)
LARGE_REGIONS = wp.constant(64)

TILE_BITS = wp.constant(16)
"""Bits of the numbers of a tile's column and row among the tiles of its triangle."""

LINE = wp.constant(32)
"""Counters of a cache line, of which one is used: those of a line take turns."""

SMALL = wp.constant(1)
LARGE = wp.constant(257)
COUNTERS = 321
"""The first counter is that of the blocks, then come those of the triangles' regions and of the large ones'."""


@wp.func
def take(counters: wp.array(dtype=int), counter: int, places: int):
    """Takes so many places of a list, and gives the first of them."""
    return wp.atomic_add(counters, counter * LINE, places)


@wp.kernel
def list_blocks(
    # in
    view: CameraView,
    env0: int,
    block0: int,
    blocks: Blocks,
    rotation: wp.array2d(dtype=wp.mat33),
    translation: wp.array2d(dtype=wp.vec3),
    # out
    counters: wp.array(dtype=int),
    listed: wp.array(dtype=wp.vec4i),
):
    """Lists the blocks that may be seen, in any order.

    Args:
        env0: first environment; block0: first block.
        rotation, translation: [E, I] instance to camera.
        counters: the first one counts what is listed.
        listed: (environment, instance, first and last triangle) of each block.
    """
    index, block = wp.tid()
    env = env0 + index
    n = block0 + block
    i = blocks.instance[n]
    if not unseen(view, 0, view.height, blocks, n, rotation[env, i], translation[env, i]):
        listed[wp.atomic_add(counters, 0, 1)] = wp.vec4i(env, i, blocks.first[n], blocks.last[n])


@wp.func
def placed_corners(
    view: CameraView,
    vertices: wp.array2d(dtype=wp.vec3),
    triangles: wp.array(dtype=wp.vec3i),
    rotation: wp.array2d(dtype=wp.mat33),
    translation: wp.array2d(dtype=wp.vec3),
    env: int,
    i: int,
    t: int,
):
    """Fetches the corners of triangle t of instance i in the camera frame of an environment."""
    at = env * rotation.shape[1] + i
    return corners_of(view, vertices, triangles, matrix_at(rotation, at), vector_at(translation, at), env, t)


@cache
def make_steps(lens: str, area: int, rows: int) -> tuple[wp.Function, wp.Function]:
    """Makes the functions `shows` and `draw`.

    area: bounding box [px] above which a triangle is cut into tiles. rows: of a tile.
    """
    bounds_of = make_bounds(lens) if lens != "none" else bounds
    walk_over = walk_rays if lens != "none" else walk_all

    @wp.func
    def shows(view: CameraView, a: wp.vec3, b: wp.vec3, c: wp.vec3, two_sided: int):
        """Tells whether a triangle faces the camera and has a pixel centre in its bounds, and these bounds."""
        box = wp.vec4()
        if not (facing(a, b, c, two_sided) and before_near(view, a, b, c)):
            return False, box
        box = bounds_of(view, a, b, c)
        return holds_pixel(view, box), box

    @wp.func
    def draw(
        view: CameraView,
        env: int,
        t: int,
        a: wp.vec3,
        b: wp.vec3,
        c: wp.vec3,
        box: wp.vec4,
        counters: wp.array(dtype=int),
        large: wp.array2d(dtype=wp.vec4i),
        setups: wp.array3d(dtype=wp.vec4),
        packed: wp.array3d(dtype=wp.uint64),
    ):
        """Draws a small triangle, lists the tiles of a large one; box: its bounds, which hold a pixel's centre."""
        s = set_up(view, a, b, c, box)
        face = face_from(t, s.offset)
        mine = wp.bool(True)
        if (s.x1 - s.x0 + 1) * (s.y1 - s.y0 + 1) > wp.static(area):
            tiles = ((s.x1 - s.x0) // WIDE + 1) * ((s.y1 - s.y0) // wp.static(rows) + 1)
            there = (t + 7 * env) % LARGE_REGIONS
            first = take(counters, LARGE + there, tiles)
            # What the list has no room for is walked at once.
            mine = first + tiles > large.shape[1]
            if not mine:
                store_setup(setups, there, first, s)
            n = first
            for row in range((s.y1 - s.y0) // wp.static(rows) + 1):
                for column in range((s.x1 - s.x0) // WIDE + 1):
                    if n < large.shape[1]:
                        large[there, n] = wp.vec4i(env, wp.where(mine, -1, face), column | (row << TILE_BITS), first)
                    n += 1
        if mine:
            walk_over(view, s, s.x0, s.x1, s.y0, s.y1, env, face, packed)

    return shows, draw


def make_listed(lens: str, area: int, rows: int) -> tuple[wp.Kernel, wp.Kernel]:
    """Makes the kernels `list_triangles` and `raster`; arguments as of `make_steps`."""
    bounds_of = make_bounds(lens) if lens != "none" else bounds
    shows, draw = make_steps(lens, area, rows)

    @wp.kernel(module="unique", enable_backward=False)
    def list_triangles(
        # in
        view: CameraView,
        workers: int,
        two_sided: wp.array(dtype=int),
        rotation: wp.array2d(dtype=wp.mat33),
        translation: wp.array2d(dtype=wp.vec3),
        vertices: wp.array2d(dtype=wp.vec3),
        triangles: wp.array(dtype=wp.vec3i),
        listed: wp.array(dtype=wp.vec4i),
        # in and out
        counters: wp.array(dtype=int),
        # out
        small: wp.array2d(dtype=wp.vec2i),
    ):
        """Lists the triangles that face the camera and have a pixel centre in their bounds.

        Args:
            workers: threads that share the list of blocks.
            two_sided: [I] whether an instance shows its back.
            rotation, translation: [E, I] instance to camera.
            vertices: [1, V] in the frames of their instances.
            triangles: [T] vertices of each.
            listed: of `list_blocks`.
            counters: one for each region of `small`, LINE apart.
            small: (environment, triangle) of each, by region.
        """
        tid = wp.tid()
        item = tid // BLOCK_THREADS
        count = counters[0]
        while item < count:
            block = whole_four(listed, item)
            env = block[0]
            i = block[1]
            t = block[2] + tid % BLOCK_THREADS
            if t < block[3]:
                a, b, c = placed_corners(view, vertices, triangles, rotation, translation, env, i, t)
                shown, _ = shows(view, a, b, c, two_sided[i])
                if shown:
                    region = item % SMALL_REGIONS
                    small[region, take(counters, SMALL + region, 1)] = wp.vec2i(env, t)
            item += workers // BLOCK_THREADS

    @wp.kernel(module="unique", enable_backward=False)
    def raster(
        # in
        view: CameraView,
        workers: int,
        instance: wp.array(dtype=int),
        rotation: wp.array2d(dtype=wp.mat33),
        translation: wp.array2d(dtype=wp.vec3),
        vertices: wp.array2d(dtype=wp.vec3),
        triangles: wp.array(dtype=wp.vec3i),
        small: wp.array2d(dtype=wp.vec2i),
        # in and out
        counters: wp.array(dtype=int),
        # out
        large: wp.array2d(dtype=wp.vec4i),
        setups: wp.array3d(dtype=wp.vec4),
        packed: wp.array3d(dtype=wp.uint64),
    ):
        """Draws the listed triangles; large ones are listed in turn.

        Args:
            workers: threads that share the list.
            instance: of each triangle [T].
            rotation, translation, vertices, triangles, small: as of `list_triangles`.
            large: (environment, triangle, column and row of tiles, place in `setups`) of each tile, by region.
            setups: of the large triangles, see `store_setup`.
            packed: z-buffer [E, H, W].
        """
        tid = wp.tid()
        region = (tid // GROUP) % SMALL_REGIONS
        at = tid // (GROUP * SMALL_REGIONS) * GROUP + tid % GROUP
        count = counters[(SMALL + region) * LINE]
        while at < count:
            one = small[region, at]
            env = one[0]
            t = one[1]
            a, b, c = placed_corners(view, vertices, triangles, rotation, translation, env, instance[t], t)
            draw(view, env, t, a, b, c, bounds_of(view, a, b, c), counters, large, setups, packed)
            at += workers // SMALL_REGIONS

    return list_triangles, raster


def make_at_once(lens: str, area: int, rows: int) -> wp.Kernel:
    """Makes the kernel `raster_at_once`, in place of those of `make_listed`; arguments as of `make_steps`."""
    shows, draw = make_steps(lens, area, rows)

    @wp.kernel(module="unique", enable_backward=False)
    def raster_at_once(
        # in
        view: CameraView,
        workers: int,
        env0: int,
        envs: int,
        block0: int,
        count: int,
        blocks: Blocks,
        two_sided: wp.array(dtype=int),
        rotation: wp.array2d(dtype=wp.mat33),
        translation: wp.array2d(dtype=wp.vec3),
        vertices: wp.array2d(dtype=wp.vec3),
        triangles: wp.array(dtype=wp.vec3i),
        # in and out
        counters: wp.array(dtype=int),
        # out
        large: wp.array2d(dtype=wp.vec4i),
        setups: wp.array3d(dtype=wp.vec4),
        packed: wp.array3d(dtype=wp.uint64),
    ):
        """Draws all triangles of the blocks block0.. that may be seen.

        It is sooner done than by lists where there are not many, for nothing waits for a list.

        Args:
            workers: threads that share the triangles.
            env0, envs: first environment and their number; block0, count: the same of the blocks.
            two_sided, rotation, translation, vertices, triangles: as of `list_triangles`.
            counters, large, setups, packed: as of `raster`.
        """
        tid = wp.tid()
        item = tid // BLOCK_THREADS
        while item < envs * count:
            env = env0 + item // count
            n = block0 + item % count
            i = blocks.instance[n]
            t = blocks.first[n] + tid % BLOCK_THREADS
            if t < blocks.last[n] and not unseen(
                view, 0, view.height, blocks, n, rotation[env, i], translation[env, i]
            ):
                a, b, c = placed_corners(view, vertices, triangles, rotation, translation, env, i, t)
                shown, box = shows(view, a, b, c, two_sided[i])
                if shown:
                    draw(view, env, t, a, b, c, box, counters, large, setups, packed)
            item += workers // BLOCK_THREADS

    return raster_at_once
