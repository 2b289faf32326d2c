"""Finds z-buffers between the frames of a gap in their order, and counts what a pixel shows in one of them alone."""

import warp as wp

from nodes.renderer.raster.depth_kernels import MISS, triangle_of

wp.set_module_options({"enable_backward": False})


@wp.func
def probe_image(coarse: int, k: int, i: int, parts: int):
    """Gives which z-buffer of `Probes.packed` shows coarse interval k after i of `parts` equal parts of it.

    Middles come first, those of all intervals after each other, then quarters, as `order_of` has drawn them. parts: a
    power of two. i: 1 .. parts - 1.
    """
    half = parts >> 1
    odd = i
    while (odd & 1) == 0:
        odd = odd >> 1
        half = half >> 1
    return coarse * (half - 1) + k * half + (odd >> 1)


@wp.func
def shown_at(
    coarse: int,
    envs: int,
    each: int,
    env: int,
    y: int,
    x: int,
    j: int,
    pieces: wp.array(dtype=wp.vec2i),
    start: wp.array3d(dtype=wp.uint64),
    frames: wp.array3d(dtype=wp.uint64),
    probed: wp.array3d(dtype=wp.uint64),
):
    """Gives the body that a pixel shows in z-buffer j of a gap, -1 = none; arguments as of count_single_appearances."""
    k = j // each
    i = j % each
    hit = wp.uint64(0)
    if j == 0:
        hit = start[env, y, x]
    elif i == 0:
        hit = frames[wp.where(k == coarse, 0, k) * envs + env, y, x]
    else:
        hit = probed[probe_image(coarse, k, i, each) * envs + env, y, x]
    t = triangle_of(hit)
    if t == MISS:
        return -1
    return pieces[t][0]


@wp.kernel
def count_single_appearances(
    # in
    coarse: int,
    asked: wp.array(dtype=int),
    each: wp.array(dtype=int),
    pieces: wp.array(dtype=wp.vec2i),
    start: wp.array3d(dtype=wp.uint64),
    frames: wp.array3d(dtype=wp.uint64),
    probed: wp.array3d(dtype=wp.uint64),
    # out
    appearances: wp.array(dtype=int),
):
    """Counts how often a pixel shows a body in one z-buffer and in neither of those beside it: appearances [E].

    asked: not 0 for environments whose pixels are counted. each: z-buffers per coarse interval, `coarse` of which a gap
    has. start: z-buffer of keyframe A. frames: those of B and of sub-frames 1 .. K - 1. probed: those in between, as of
    Probes.
    """
    env, y, x = wp.tid()
    if asked[env] == 0:
        return
    envs = asked.shape[0]
    count = wp.int32(0)
    before = shown_at(coarse, envs, each[env], env, y, x, 0, pieces, start, frames, probed)
    now = shown_at(coarse, envs, each[env], env, y, x, 1, pieces, start, frames, probed)
    for j in range(2, coarse * each[env] + 1):
        then = shown_at(coarse, envs, each[env], env, y, x, j, pieces, start, frames, probed)
        if now != before and now != then:
            count += 1
        before = now
        now = then
    if count > 0:
        wp.atomic_add(appearances, env, count)
