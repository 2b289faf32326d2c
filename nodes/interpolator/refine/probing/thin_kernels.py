"""Counts how often things would pass a pixel between two z-buffers without being seen in either, and how often what is
painted on them would between two instants."""

from functools import cache

import warp as wp

from nodes.interpolator.displacement_kernels import BodyMotion, displaced
from nodes.renderer.raster.depth_kernels import MISS, depth_of, triangle_of
from nodes.renderer.raster.lens.displacement_kernels import make_displacement
from nodes.renderer.raster.lens.view_kernels import CameraView, pixel_ray, pixel_width

wp.set_module_options({"enable_backward": False})

REACH = wp.constant(64)
"""Widest thing [px] that is measured; wider ones are not missed."""
THIN = wp.constant(0.125)
"""Width [px] taken for a thing that one pixel alone shows, as it may be much thinner than a pixel."""
BEHIND = wp.constant(0)
IN_FRONT = wp.constant(1)
OUTSIDE = wp.constant(2)
STEP = wp.constant(2.0)
"""Distance [px] from a silhouette within which pixels on one side of it may show what is on the other."""
SLANTS, SLANT = wp.constant(3), wp.constant(0.2618)
"""How many steps of so many rad a slit may be turned, either way, from across the motion: STEP along the nearest of
these directions is 0.3 px beside it at most. Nearer to the motion, steps of pixels along a silhouette would count."""
BEFORE = wp.constant(1.1)
"""How much farther the other side of a slit may be than this one."""
MOST_NEEDED = wp.constant(4096)
"""Most z-buffers per gap that are counted as needed."""


@wp.func
def width_to(
    packed: wp.array3d(dtype=wp.uint64),
    instance: wp.array(dtype=int),
    row: int,
    y: int,
    x: int,
    hit: wp.uint64,
    along: wp.vec2,
    reach: int,
):
    """Counts the pixels from (x, y) along a direction to where its instance ends in front of something farther.

    Gives 0 where it does not end within `reach` pixels, or is cut off by something nearer or by the image's border.
    """
    shown = instance[triangle_of(hit)]
    for s in range(1, reach + 1):
        i = int(wp.floor(float(x) + along[0] * float(s) + 0.5))
        j = int(wp.floor(float(y) + along[1] * float(s) + 0.5))
        if i < 0 or j < 0 or i >= packed.shape[2] or j >= packed.shape[1]:
            return 0
        other = packed[row, j, i]
        u = triangle_of(other)
        if u == MISS:
            return s
        if instance[u] != shown:
            if depth_of(other) > depth_of(hit):
                return s
            return 0
    return 0


@wp.func
def in_front(
    packed: wp.array3d(dtype=wp.uint64),
    pieces: wp.array(dtype=wp.vec2i),
    row: int,
    at: wp.vec2,
    body: int,
    hit: wp.uint64,
):
    """Tells whether the pixel at a place shows a body, about as near as `hit` or nearer: IN_FRONT; or is none:
    OUTSIDE."""
    i = int(wp.floor(at[0] + 0.5))
    j = int(wp.floor(at[1] + 0.5))
    if i < 0 or j < 0 or i >= packed.shape[2] or j >= packed.shape[1]:
        return OUTSIDE
    other = packed[row, j, i]
    t = triangle_of(other)
    if t != MISS:
        if pieces[t][0] == body and depth_of(other) <= BEFORE * depth_of(hit):
            return IN_FRONT
    return BEHIND


@wp.func
def gap_to(
    packed: wp.array3d(dtype=wp.uint64),
    pieces: wp.array(dtype=wp.vec2i),
    row: int,
    y: int,
    x: int,
    hit: wp.uint64,
    along: wp.vec2,
    reach: int,
):
    """Counts the pixels of something farther from (x, y), at the end of a thing, along a direction to where its body
    goes on in front of that. Gives 0 where it does not within `reach` pixels, and where that is only a step of pixels
    along a silhouette: a slit goes on from its middle to both sides, across the motion or at a slant to it."""
    body = pieces[triangle_of(hit)][0]
    start = wp.vec2(float(x), float(y))
    # Steps along a slant may stay in a pixel.
    passed = wp.int32(0)
    last = start
    for s in range(1, reach + 1):
        at = start + float(s) * along
        pixel = wp.vec2(wp.floor(at[0] + 0.5), wp.floor(at[1] + 0.5))
        there = in_front(packed, pieces, row, at, body, hit)
        if there == OUTSIDE:
            return 0
        if there == IN_FRONT:
            middle = start + 0.5 * float(s) * along
            for n in range(-SLANTS, SLANTS + 1):
                slant = SLANT * float(n)
                c, d = wp.cos(slant), wp.sin(slant)
                beside = STEP * wp.vec2(-c * along[1] - d * along[0], c * along[0] - d * along[1])
                left = in_front(packed, pieces, row, middle + beside, body, hit)
                right = in_front(packed, pieces, row, middle - beside, body, hit)
                if left != IN_FRONT and right != IN_FRONT:
                    return wp.where(passed == 1, 1, s - 1)
            return 0
        if wp.length_sq(pixel - last) > 0.0:
            passed += 1
        last = pixel
    return 0


@wp.func
def count_passes(missed: wp.array2d(dtype=wp.int64), env: int, least: int, wanted: float, pixels: int):
    """Adds up how often something that wants so many z-buffers per gap passes so many pixels, and how often unseen;
    missed, least: as of find_thin."""
    needed = int(wp.min(wanted, float(MOST_NEEDED)))
    levels = missed.shape[1] - 2
    wp.atomic_add(missed, env, levels, wp.int64(pixels * needed))
    for level in range(levels):
        short = needed - (least << level)
        if short > 0:
            wp.atomic_add(missed, env, level, wp.int64(pixels * short))


@wp.func
def count_swings(missed: wp.array2d(dtype=wp.int64), env: int, instants: int, speed: float, scale: float):
    """Adds up how often what is painted goes up or down more than once from one instant to the next; missed, instants:
    as of find_thin.

    speed: over a pixel [px per gap]. scale: way over which it goes up or down [px]; what is finer than pixels counts as
    wide as they are.
    """
    swings = wp.min(speed / wp.max(scale, 1.0), float(MOST_NEEDED))
    if swings > float(instants):
        wp.atomic_add(missed, env, missed.shape[1] - 1, wp.int64(swings) - wp.int64(instants))


@cache
def make_find_thin(lens: str) -> wp.Kernel:
    """Makes the kernel `find_thin`. lens: `none` or a distortion model."""
    displacement = make_displacement(lens)

    @wp.kernel(module="unique", enable_backward=False)
    def find_thin(
        # in
        view: CameraView,
        envs: int,
        row0: int,
        y0: int,
        span: int,
        gaps: wp.array(dtype=float),
        least: int,
        instants: int,
        own: wp.array(dtype=int),
        motions: wp.array2d(dtype=BodyMotion),
        pieces: wp.array(dtype=wp.vec2i),
        instance: wp.array(dtype=int),
        albedo_scale: wp.array(dtype=float),
        packed: wp.array3d(dtype=wp.uint64),
        # out
        missed: wp.array2d(dtype=wp.int64),
    ):
        """Adds up, for least, 2 least, 4 least .. z-buffers per gap, how often things pass a pixel between two of them
        unseen: missed [E, levels + 2], over all rows; then how often they pass, and how often what is painted on them
        does between two of so many instants per gap. albedo_scale: of each triangle, as of albedo_scale_of.

        motions [rows, N + 2]: how bodies have moved since a short time before, against the camera; gaps [E]: how
        many such times a gap has. packed [rows, H, W]: z-buffers, from row0 on, of which an environment has own [E].
        y0: row of the image to begin with.
        """
        row, line, part = wp.tid()
        y = y0 + line
        if (row0 + row) // envs >= own[row % envs]:
            return
        for x in range(part * span, wp.min(part * span + span, view.width)):
            hit = packed[row, y, x]
            t = triangle_of(hit)
            if t != MISS:
                body = pieces[t][0]
                d = pixel_ray(view, x, y)
                point = depth_of(hit) * d
                m = displaced(motions, row * motions.shape[1] + body, point)
                way = gaps[row % envs] * displacement(view, d, point, m, view.near)
                speed = wp.length(way)
                if speed > float(instants) and wp.isfinite(speed):
                    fine = albedo_scale[t] / pixel_width(view, x, y, depth_of(hit))
                    count_swings(missed, row % envs, instants, speed, fine)
                if speed > THIN * float(least) and wp.isfinite(speed):
                    along = way / speed
                    reach = wp.min(int(wp.min(speed / float(least), float(REACH))) + 1, REACH)
                    ahead = width_to(packed, instance, row, y, x, hit, along, reach)
                    behind = wp.int32(0)
                    if ahead == 1:
                        # It is at an edge: what is seen beside it may be so through a slit alone.
                        slit = gap_to(packed, pieces, row, y, x, hit, along, reach)
                        if slit > 0:
                            width = wp.where(slit == 1, THIN, float(slit))
                            count_passes(missed, row % envs, least, speed / width, slit)
                    if ahead > 0:
                        behind = width_to(packed, instance, row, y, x, hit, -along, reach)
                    if behind > 0:
                        width = float(ahead + behind - 1)
                        if ahead + behind == 2:
                            width = THIN
                        count_passes(missed, row % envs, least, speed / width, 1)

    return find_thin
