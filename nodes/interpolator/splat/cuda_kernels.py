"""Schedules the warp on a GPU: sources are listed by where they land, and every pixel sums what landed about it. The
equations are in warp_kernels.

A source lands between four pixels, of which the first is its cell: each cell has a chain of its sources, made by one
atomic exchange per source and sub-frame. The order of a chain is anybody's, but least depths and sums in whole numbers
do not depend on it: a weight has 24 bits, a value 56 bits below the power of two above the keyframe's brightest, in two
parts, of which the lower one is 0 for all but dark pixels. That leaves room for 2^9 whole pixels on one target.

Kernels over many pixels take their index apart themselves: Warp does that in 64 bits, which takes as long as the rest.
"""

import warp as wp

from nodes.interpolator.splat.cuda_source_kernels import BROKEN, LOW, LOW_BITS, STAYS, Sources, scale_of
from nodes.interpolator.splat.warp_kernels import (
    EMPTY,
    SUBPIXEL,
    SUBPIXEL_BITS,
    Source,
    background,
    bent,
    bilinear,
    counts_as_filled,
    depth_at,
    padded,
    same_surface,
    share_gone,
    target_of,
)

wp.set_module_options({"enable_backward": False})

MORE = wp.constant(1 << 24)
"""Set in a place: another source comes after this one in its chain."""
ROOM = wp.constant(wp.int64(2**33))
"""Sum of weights from which on sums of values may not fit."""
HOLE = wp.constant(-1.0)
"""Depth of a target that shows nothing."""
LIST_WORKERS = wp.constant(1 << 16)
"""Threads that share a list whose length only the device knows."""


@wp.struct
class Chains:
    """Holds chained lists of the sources that land in each cell of a sub-frame.

    first: 1 + a source in each cell [rows, padded], 0 = none.

    Of each source [rows, H W], where it is in a chain: landed: its fractions in x (12 bits) and y, and MORE, as the
    upper half, and the bits of its depth; next: 1 + the one after it, where there is MORE.
    """

    first: wp.array2d(dtype=wp.int32)
    next: wp.array2d(dtype=wp.int32)
    landed: wp.array2d(dtype=wp.int64)


@wp.struct
class Tap:
    """Holds a source on a target; weight 0 where there is none. next: 1 + the source after it in its chain."""

    weight: wp.int32
    z: wp.float32
    value: wp.int64
    next: wp.int32


@wp.struct
class Sum:
    """Holds the weighted sum of a channel's values on a target, of sources no farther than a limit."""

    weight: wp.int64
    high: wp.int64
    low: wp.int64
    broken: wp.int32


@wp.func
def has_hole(nearest: wp.array2d(dtype=wp.float32), row: int, at: int, width: int):
    """Tells whether one of the four pixels from the padded index `at` on shows nothing."""
    above = nearest[row, at] < 0.0 or nearest[row, at + 1] < 0.0
    return above or nearest[row, at + width + 2] < 0.0 or nearest[row, at + width + 3] < 0.0


@wp.kernel
def link_all(
    # in
    start: int,
    upsampling: int,
    width: int,
    height: int,
    backward: int,
    s: Sources,
    nearest: wp.array2d(dtype=wp.float32),
    # out
    chains: Chains,
):
    """Links sources into the chains of the cells they land in, in every sub-frame from `start` on; A's beside holes."""
    row = wp.tid() // (width * height)
    pixel = wp.tid() - row * width * height
    sub = start + row
    env = sub // (upsampling - 1)
    move = s.moves[env, pixel]
    if move[3] == STAYS:
        return
    share = share_gone(sub % (upsampling - 1) + 1, upsampling, backward)
    source = Source()
    source.x = float(SUBPIXEL) * float(pixel % width)
    source.y = float(SUBPIXEL) * float(pixel // width)
    source.dx = move[0]
    source.dy = move[1]
    source.z = move[2]
    source.dz = move[3]
    source.pixel = pixel
    target = target_of(bent(source, share, env, s.bends), share, width, height)
    if target.at >= 0:
        if backward == 0 and not has_hole(nearest, row, target.at, width):
            return
        place = target.fx + target.fy * SUBPIXEL
        following = wp.atomic_exch(chains.first, row, target.at, pixel + 1)
        if following != 0:
            chains.next[row, pixel] = following
            place += MORE
        depth = wp.int64(wp.cast(depth_at(source, share), wp.uint32))
        chains.landed[row, pixel] = (wp.int64(place) << wp.int64(32)) + depth


@wp.func
def tap_of(s: Sources, chains: Chains, row: int, env: int, c: int, index: int, right: int, down: int):
    """Reads the source index - 1 of the cell that lies `right` and `down` before the target; none for index 0."""
    tap = Tap()
    tap.z = EMPTY
    if index != 0:
        landed = chains.landed[row, index - 1]
        tap.value = s.values[env, index - 1, c]
        place = wp.int32(landed >> wp.int64(32))
        tap.z = wp.cast(wp.uint32(landed), wp.float32)
        if place >= MORE:
            tap.next = chains.next[row, index - 1]
        tap.weight = bilinear(place & (SUBPIXEL - 1), (place >> SUBPIXEL_BITS) & (SUBPIXEL - 1), right, down)
        if tap.weight == 0:
            tap.z = EMPTY
    return tap


@wp.func
def with_tap(total: Sum, tap: Tap, limit: wp.float32):
    """Adds a tap to a sum if it is no farther than `limit` allows."""
    result = total
    if same_surface(tap.z, limit) and tap.weight != 0:
        result.weight += wp.int64(tap.weight)
        if tap.value == BROKEN:
            result.broken = 1
        else:
            high = tap.value >> LOW_BITS
            result.high += wp.int64(tap.weight) * high
            result.low += wp.int64(tap.weight) * (tap.value - (high << LOW_BITS))
    return result


@wp.func
def show(
    s: Sources,
    chains: Chains,
    row: int,
    env: int,
    pixel: int,
    frame: int,
    width: int,
    frames: wp.array3d(dtype=wp.float32),
):
    """Averages the sources on a pixel within 1 % of the nearest, and what stays there, into `frames`, equation (7).

    Gives the least depth, or HOLE where there is no source. A target with more sources than there is room for keeps the
    keyframe's own pixel. The four cells are read side by side, for a GPU waits less then; chains of more than one
    source are gone through twice.
    """
    at = padded(pixel, width)
    z = s.still[env, at]
    first0 = chains.first[row, at]
    first1 = chains.first[row, at - 1]
    first2 = chains.first[row, at - width - 2]
    first3 = chains.first[row, at - width - 3]
    nearest = HOLE
    for c in range(frames.shape[2]):
        t0 = tap_of(s, chains, row, env, c, first0, 0, 0)
        t1 = tap_of(s, chains, row, env, c, first1, 1, 0)
        t2 = tap_of(s, chains, row, env, c, first2, 0, 1)
        t3 = tap_of(s, chains, row, env, c, first3, 1, 1)
        reached = wp.min(wp.min(wp.min(t0.z, t1.z), wp.min(t2.z, t3.z)), z)
        u0 = t0
        u1 = t1
        u2 = t2
        u3 = t3
        while u0.next + u1.next + u2.next + u3.next != 0:
            u0 = tap_of(s, chains, row, env, c, u0.next, 0, 0)
            u1 = tap_of(s, chains, row, env, c, u1.next, 1, 0)
            u2 = tap_of(s, chains, row, env, c, u2.next, 0, 1)
            u3 = tap_of(s, chains, row, env, c, u3.next, 1, 1)
            reached = wp.min(wp.min(wp.min(u0.z, u1.z), wp.min(u2.z, u3.z)), reached)
        total = Sum()
        total = with_tap(with_tap(with_tap(with_tap(total, t0, reached), t1, reached), t2, reached), t3, reached)
        while t0.next + t1.next + t2.next + t3.next != 0:
            t0 = tap_of(s, chains, row, env, c, t0.next, 0, 0)
            t1 = tap_of(s, chains, row, env, c, t1.next, 1, 0)
            t2 = tap_of(s, chains, row, env, c, t2.next, 0, 1)
            t3 = tap_of(s, chains, row, env, c, t3.next, 1, 1)
            total = with_tap(with_tap(with_tap(with_tap(total, t0, reached), t1, reached), t2, reached), t3, reached)
        stays = z < EMPTY and same_surface(z, reached)
        if stays or total.weight > wp.int64(0):
            nearest = reached
            shown = s.image[env, pixel, c]
            if total.weight > wp.int64(0) and total.weight < ROOM:
                scale = scale_of(s.brightest[env])
                value = wp.float64(total.high) + wp.float64(total.low) / LOW
                weight = wp.float64(total.weight)
                if stays:
                    own = wp.float64(SUBPIXEL) * wp.float64(SUBPIXEL)
                    value += own * wp.float64(shown) * scale
                    weight += own
                shown = wp.float32(value / (weight * scale))
                if total.broken != 0:
                    shown = float(wp.nan)
            frames[frame, pixel, c] = shown
    return nearest


@wp.func
def frame_of(sub: int, upsampling: int):
    """Computes the index of a sub-frame among the frames, of which every K-th is a keyframe."""
    return sub // (upsampling - 1) * upsampling + sub % (upsampling - 1)


@wp.kernel
def show_all(
    # in
    start: int,
    upsampling: int,
    width: int,
    from_b: Sources,
    chains: Chains,
    # out
    nearest: wp.array2d(dtype=wp.float32),
    frames: wp.array3d(dtype=wp.float32),
    holes: wp.array(dtype=wp.int32),
    count: wp.array(dtype=wp.int32),
):
    """Shows every pixel of every sub-frame from B, and lists those where B has nothing, in any order."""
    pixels = from_b.moves.shape[1]
    row = wp.tid() // pixels
    pixel = wp.tid() - row * pixels
    sub = start + row
    z = show(from_b, chains, row, sub // (upsampling - 1), pixel, frame_of(sub, upsampling), width, frames)
    nearest[row, padded(pixel, width)] = z
    if z < 0.0:
        holes[wp.atomic_add(count, 0, 1)] = wp.tid()


@wp.kernel
def show_holes(
    # in
    start: int,
    upsampling: int,
    width: int,
    from_a: Sources,
    chains: Chains,
    holes: wp.array(dtype=wp.int32),
    count: wp.array(dtype=wp.int32),
    # out
    nearest: wp.array2d(dtype=wp.float32),
    frames: wp.array3d(dtype=wp.float32),
):
    """Shows the listed pixels from A."""
    k = wp.tid()
    pixels = from_a.moves.shape[1]
    while k < count[0]:
        row = holes[k] // pixels
        pixel = holes[k] % pixels
        sub = start + row
        z = show(from_a, chains, row, sub // (upsampling - 1), pixel, frame_of(sub, upsampling), width, frames)
        nearest[row, padded(pixel, width)] = z
        k += LIST_WORKERS


@wp.kernel
def fill(
    # in
    start: int,
    upsampling: int,
    width: int,
    height: int,
    margin: int,
    nearest: wp.array2d(dtype=wp.float32),
    image: wp.array3d(dtype=wp.float32),
    holes: wp.array(dtype=wp.int32),
    count: wp.array(dtype=wp.int32),
    # out
    frames: wp.array3d(dtype=wp.float32),
    filled: wp.array(dtype=wp.int32),
    first: wp.array2d(dtype=wp.int32),
):
    """Fills pixels seen in neither keyframe with their nearest background; where there is none, with B's value.

    first: of A's chains, all of which are beside holes: emptied for the next gap.
    """
    k = wp.tid()
    while k < count[0]:
        row = holes[k] // image.shape[1]
        pixel = holes[k] % image.shape[1]
        at = padded(pixel, width)
        first[row, at] = 0
        first[row, at - 1] = 0
        first[row, at - width - 2] = 0
        first[row, at - width - 3] = 0
        if nearest[row, at] < 0.0:
            frame = frame_of(start + row, upsampling)
            if counts_as_filled(pixel, width, height, margin):
                wp.atomic_add(filled, 0, 1)
            known = background(nearest[row], pixel, width, height)
            for c in range(frames.shape[2]):
                if known >= 0:
                    frames[frame, pixel, c] = frames[frame, known, c]
                else:
                    frames[frame, pixel, c] = image[(start + row) // (upsampling - 1), pixel, c]
        k += LIST_WORKERS
