"""Kernels of the warp on a GPU: one thread per source and sub-frame, and sums that do not depend on their order.

Depths meet by atomic minimum, sums in whole numbers: a weight has 24 bits, a value 56 bits below the power of two above
the keyframe's brightest, in two parts, of which the lower one is 0 for all but dark pixels. That leaves room for 2^9
whole pixels on one target.
"""

import warp as wp

from nodes.interpolator.kernels import (
    EMPTY,
    SAME_SURFACE,
    SUBPIXEL,
    Source,
    Target,
    background,
    bent,
    displaced_depth,
    known_depth,
    padded,
    target_of,
)

wp.set_module_options({"enable_backward": False})

HIGH_BITS = wp.constant(wp.int64(30))
LOW = wp.constant(wp.float64(2.0**26))
ROOM = wp.constant(wp.int64(2**33))
WHOLE = wp.constant(wp.int64(2**40 - 1))
"""The part of a sum of weights that is weight; above, 8 bits for each channel count values that are not finite."""
STAYS = wp.constant(2.0e38)
"""dz of a source that does not move, or has no tap because its motion is not finite."""
EXPONENTS = 256
"""Exponents that a float32 can have."""


@wp.func
def exponent_of(value: wp.float32):
    """2^(this - 126) is the least power of two above a finite |value|."""
    return wp.int32((wp.cast(value, wp.uint32) >> wp.uint32(23)) & wp.uint32(255))


@wp.kernel
def locate(
    # in
    sign: wp.float32,
    keyframe: int,
    held: wp.array(dtype=wp.int32),
    depth: wp.array3d(dtype=wp.float32),
    other_depth: wp.array3d(dtype=wp.float32),
    motion: wp.array4d(dtype=wp.float32),
    bends: wp.array2d(dtype=wp.vec2),
    image: wp.array3d(dtype=wp.float32),
    # out
    moves: wp.array2d(dtype=wp.vec4),
    still: wp.array2d(dtype=wp.float32),
    seen: wp.array3d(dtype=wp.int32),
    lost: wp.array(dtype=wp.int32),
):
    """Every pixel of a keyframe as a source: (dx, dy) in 1/4096 px, depth and its change.

    sign: +1 for B (it goes back along its motion), -1 for A. still, on the padded grid: the depth of what does not
    move, else EMPTY. seen: which exponents there are among the values.
    """
    env, y, x = wp.tid()
    pixel = y * depth.shape[2] + x
    dx = sign * motion[env, y, x, 0]
    dy = sign * motion[env, y, x, 1]
    z = depth[env, y, x]
    own = known_depth(z)
    at = (y + 1) * (depth.shape[2] + 2) + x + 1
    move = wp.vec4(0.0, 0.0, own, STAYS)
    straight = wp.bool(True)
    if bends.shape[1] > 0:
        straight = bends[env, pixel][0] == 0.0 and bends[env, pixel][1] == 0.0
    stays = held[env] != 0 or (straight and dx == 0.0 and dy == 0.0 and z == other_depth[env, y, x])
    still[env, at] = wp.where(stays, own, EMPTY)
    if not stays:
        if wp.abs(dx) < 1.0e6 and wp.abs(dy) < 1.0e6:
            there = displaced_depth(other_depth, env, float(x) + dx, float(y) + dy, own)
            move = wp.vec4(float(SUBPIXEL) * dx, float(SUBPIXEL) * dy, own, there - own)
        elif not (wp.isfinite(dx) and wp.isfinite(dy)):
            wp.atomic_add(lost, 0, 1)
    moves[env, pixel] = move
    for c in range(image.shape[2]):
        e = exponent_of(image[env, pixel, c])
        if e < 255 and seen[keyframe, env, e] == 0:
            seen[keyframe, env, e] = 1


@wp.kernel
def find_brightest(
    # in
    seen: wp.array3d(dtype=wp.int32),
    # out
    brightest: wp.array2d(dtype=wp.int32),
):
    """The largest exponent of each keyframe and environment."""
    keyframe, env, e = wp.tid()
    if seen[keyframe, env, e] != 0:
        wp.atomic_max(brightest, keyframe, env, e)


@wp.kernel
def begin(
    # in
    first: int,
    upsampling: int,
    still: wp.array2d(dtype=wp.float32),
    # out
    nearest: wp.array2d(dtype=wp.float32),
):
    """Every sub-frame starts from the pixels that stay."""
    row, at = wp.tid()
    nearest[row, at] = still[(first + row) // (upsampling - 1), at]


@wp.func
def source_of(moves: wp.array2d(dtype=wp.vec4), env: int, pixel: int, width: int):
    move = moves[env, pixel]
    source = Source()
    source.x = float(SUBPIXEL) * float(pixel % width)
    source.y = float(SUBPIXEL) * float(pixel // width)
    source.dx = move[0]
    source.dy = move[1]
    source.z = move[2]
    source.dz = move[3]
    source.pixel = pixel
    return source


@wp.func
def fraction(sub: int, upsampling: int, backward: int):
    """How far a source of this sub-frame has moved: 1 - f for B, f for A, f = i / K."""
    i = sub % (upsampling - 1) + 1
    if backward != 0:
        i = upsampling - i
    return float(i) / float(upsampling)


@wp.func
def nearest_of(target: Target, row: int, nearest: wp.array2d(dtype=wp.float32)):
    """Depths of a target's four pixels, all read before any of them is written."""
    at = target.at
    return wp.vec4(
        nearest[row, at],
        nearest[row, at + target.right],
        nearest[row, at + target.down],
        nearest[row, at + target.right + target.down],
    )


@wp.func
def lower(row: int, at: int, z: wp.float32, reached: wp.float32, nearest: wp.array2d(dtype=wp.float32)):
    """A target that is no hole holds depth 0, which nothing is nearer than."""
    if z < reached:
        wp.atomic_min(nearest, row, at, z)


@wp.kernel
def lower_all(
    # in
    first: int,
    upsampling: int,
    backward: int,
    width: int,
    height: int,
    moves: wp.array2d(dtype=wp.vec4),
    bends: wp.array2d(dtype=wp.vec2),
    # out
    nearest: wp.array2d(dtype=wp.float32),
):
    """The depth of the nearest source of every target."""
    row, pixel = wp.tid()
    sub = first + row
    env = sub // (upsampling - 1)
    if moves[env, pixel][3] == STAYS:
        return
    a = fraction(sub, upsampling, backward)
    source = bent(source_of(moves, env, pixel, width), a, env, bends)
    target = target_of(source, a, width, height)
    if target.at >= 0:
        z = source.z + a * source.dz
        at = target.at
        reached = nearest_of(target, row, nearest)
        lower(row, at, z, reached[0], nearest)
        if target.right != 0:
            lower(row, at + target.right, z, reached[1], nearest)
        if target.down != 0:
            lower(row, at + target.down, z, reached[2], nearest)
            if target.right != 0:
                lower(row, at + target.right + target.down, z, reached[3], nearest)


@wp.func
def scale_of(brightest: wp.array2d(dtype=wp.int32), keyframe: int, env: int):
    """2^HIGH_BITS over the power of two above the keyframe's values."""
    return wp.cast((wp.int64(1149 - brightest[keyframe, env]) + HIGH_BITS) << wp.int64(52), wp.float64)


@wp.func
def add(
    row: int,
    at: int,
    weight: int,
    c: int,
    whole: wp.int64,
    rest: wp.int64,
    high: wp.array3d(dtype=wp.int64),
    low: wp.array3d(dtype=wp.int64),
):
    if weight > 0:
        wp.atomic_add(high, row, at, c, wp.int64(weight) * whole)
        if rest != wp.int64(0):
            wp.atomic_add(low, row, at, c, wp.int64(weight) * rest)


@wp.func
def weigh(row: int, at: int, weight: int, broken: wp.int64, weights: wp.array2d(dtype=wp.int64)):
    if weight > 0:
        wp.atomic_add(weights, row, at, wp.int64(weight) + broken)


@wp.kernel
def add_all(
    # in
    first: int,
    upsampling: int,
    backward: int,
    width: int,
    height: int,
    moves: wp.array2d(dtype=wp.vec4),
    bends: wp.array2d(dtype=wp.vec2),
    image: wp.array3d(dtype=wp.float32),
    brightest: wp.array2d(dtype=wp.int32),
    nearest: wp.array2d(dtype=wp.float32),
    # out
    high: wp.array3d(dtype=wp.int64),
    low: wp.array3d(dtype=wp.int64),
    weights: wp.array2d(dtype=wp.int64),
):
    """Bilinear sums of the sources within 1 % of the nearest."""
    row, pixel = wp.tid()
    sub = first + row
    env = sub // (upsampling - 1)
    if moves[env, pixel][3] == STAYS:
        return
    a = fraction(sub, upsampling, backward)
    source = bent(source_of(moves, env, pixel, width), a, env, bends)
    target = target_of(source, a, width, height)
    if target.at < 0:
        return
    z = (source.z + a * source.dz) * SAME_SURFACE
    at = target.at
    right = at + target.right
    below = at + target.down
    across = right + target.down
    reached = nearest_of(target, row, nearest)
    gx = SUBPIXEL - target.fx
    gy = SUBPIXEL - target.fy
    w0 = wp.where(z <= reached[0], gx * gy, 0)
    w1 = wp.where(z <= reached[1], target.fx * gy, 0)
    w2 = wp.where(z <= reached[2], gx * target.fy, 0)
    w3 = wp.where(z <= reached[3], target.fx * target.fy, 0)
    if w0 + w1 + w2 + w3 == 0:
        return
    scale = scale_of(brightest, backward, env)
    broken = wp.int64(0)
    for c in range(image.shape[2]):
        value = image[env, pixel, c]
        if wp.isfinite(value):
            share = wp.float64(value) * scale
            floor = wp.floor(share)
            whole = wp.int64(floor)
            rest = wp.int64(wp.floor((share - floor) * LOW))
            add(row, at, w0, c, whole, rest, high, low)
            add(row, right, w1, c, whole, rest, high, low)
            add(row, below, w2, c, whole, rest, high, low)
            add(row, across, w3, c, whole, rest, high, low)
        else:
            broken += wp.int64(1) << wp.int64(40 + 8 * c)
    weigh(row, at, w0, broken, weights)
    weigh(row, right, w1, broken, weights)
    weigh(row, below, w2, broken, weights)
    weigh(row, across, w3, broken, weights)


@wp.kernel
def resolve(
    # in
    first: int,
    upsampling: int,
    width: int,
    backward: int,
    image: wp.array3d(dtype=wp.float32),
    still: wp.array2d(dtype=wp.float32),
    still_a: wp.array2d(dtype=wp.float32),
    brightest: wp.array2d(dtype=wp.int32),
    # in and out
    nearest: wp.array2d(dtype=wp.float32),
    nearest_a: wp.array2d(dtype=wp.float32),
    high: wp.array3d(dtype=wp.int64),
    low: wp.array3d(dtype=wp.int64),
    weights: wp.array2d(dtype=wp.int64),
    # out
    frames: wp.array3d(dtype=wp.float32),
):
    """Sums, and what stays where it is, to pixels of `frames`. A target with more sources than there is room for keeps
    the keyframe's own pixel.

    After B the holes are opened for A (the depth of what stays there, or EMPTY) and all else closed (0); after A
    unknown pixels get depth -1 and the other holes the depth of what they show.
    """
    row, pixel = wp.tid()
    sub = first + row
    env = sub // (upsampling - 1)
    at = padded(pixel, width)
    if backward == 0 and nearest_a[row, at] == 0.0:
        return
    total = weights[row, at]
    z = still[env, at]
    reached = z
    if backward == 0:
        reached = nearest_a[row, at]
    else:
        reached = nearest[row, at]
    stays = z < EMPTY and z * SAME_SURFACE <= reached
    known = stays or total > wp.int64(0)
    if known:
        frame = env * upsampling + sub % (upsampling - 1)
        if total == wp.int64(0) or (total & WHOLE) >= ROOM:
            for c in range(frames.shape[2]):
                frames[frame, pixel, c] = image[env, pixel, c]
        else:
            scale = scale_of(brightest, backward, env)
            weight = wp.float64(total & WHOLE)
            own = wp.where(stays, wp.float64(SUBPIXEL) * wp.float64(SUBPIXEL), wp.float64(0.0))
            for c in range(frames.shape[2]):
                value = wp.float64(high[row, at, c]) + wp.float64(low[row, at, c]) / LOW
                if stays:
                    value += own * wp.float64(image[env, pixel, c]) * scale
                shown = wp.float32(value / ((weight + own) * scale))
                if ((total >> wp.int64(40 + 8 * c)) & wp.int64(255)) != wp.int64(0):
                    shown = float(wp.nan)
                frames[frame, pixel, c] = shown
        if total != wp.int64(0):
            for c in range(frames.shape[2]):
                high[row, at, c] = wp.int64(0)
                if low[row, at, c] != wp.int64(0):
                    low[row, at, c] = wp.int64(0)
            weights[row, at] = wp.int64(0)
    if backward != 0:
        nearest_a[row, at] = wp.where(known, 0.0, still_a[env, at])
    else:
        nearest[row, at] = wp.where(known, reached, -1.0)


@wp.kernel
def fill(
    # in
    first: int,
    upsampling: int,
    width: int,
    height: int,
    margin: int,
    nearest: wp.array2d(dtype=wp.float32),
    image: wp.array3d(dtype=wp.float32),
    # out
    frames: wp.array3d(dtype=wp.float32),
    filled: wp.array(dtype=wp.int32),
):
    """Pixels seen in neither keyframe take their nearest background; where there is none, B's value."""
    row, pixel = wp.tid()
    if nearest[row, padded(pixel, width)] < 0.0:
        sub = first + row
        frame = sub // (upsampling - 1) * upsampling + sub % (upsampling - 1)
        x = pixel % width
        y = pixel // width
        if wp.min(wp.min(x, width - 1 - x), wp.min(y, height - 1 - y)) >= margin:
            wp.atomic_add(filled, 0, 1)
        known = background(nearest[row], pixel, width, height)
        for c in range(frames.shape[2]):
            if known >= 0:
                frames[frame, pixel, c] = frames[frame, known, c]
            else:
                frames[frame, pixel, c] = image[sub // (upsampling - 1), pixel, c]
