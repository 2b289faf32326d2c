"""Kernels of the warp on a GPU: a thread per source does all sub-frames, and sums do not depend on their order.

Depths meet by atomic minimum, sums in whole numbers: a weight has 24 bits, a value 56 bits below the power of two
above the keyframe's brightest, in two halves, which leaves room for 2^11 whole pixels on one target.
"""

import warp as wp

from nodes.interpolator.kernels import (
    EMPTY,
    SAME_SURFACE,
    SUBPIXEL,
    Source,
    background,
    bent,
    displaced_depth,
    known_depth,
    padded,
    target_of,
)

wp.set_module_options({"enable_backward": False})

HALF = wp.constant(wp.float64(2.0**28))
ROOM = wp.constant(wp.int64(2**35))
BROKEN = wp.constant(wp.int64(2**40))
"""Weight of a value that is not finite, more than all others can have together."""
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
def lower(row: int, at: int, z: wp.float32, nearest: wp.array2d(dtype=wp.float32)):
    """A target that is no hole holds depth 0, which nothing is nearer than."""
    if z < nearest[row, at]:
        wp.atomic_min(nearest, row, at, z)


@wp.kernel
def lower_all(
    # in
    first: int,
    rows: int,
    upsampling: int,
    backward: int,
    width: int,
    height: int,
    moves: wp.array2d(dtype=wp.vec4),
    bends: wp.array2d(dtype=wp.vec2),
    # out
    nearest: wp.array2d(dtype=wp.float32),
):
    """The depth of the nearest source of every target, for sub-frames first .. first + rows - 1."""
    index, pixel = wp.tid()
    subs = upsampling - 1
    env = first // subs + index
    if moves[env, pixel][3] == STAYS:
        return
    sub = wp.max(first, env * subs)
    end = wp.min(first + rows, env * subs + subs)
    while sub < end:
        row = sub - first
        a = fraction(sub, upsampling, backward)
        source = bent(source_of(moves, env, pixel, width), a, env, bends)
        target = target_of(source, a, width, height)
        if target.at >= 0:
            z = source.z + a * source.dz
            at = target.at
            lower(row, at, z, nearest)
            if target.right != 0:
                lower(row, at + target.right, z, nearest)
            if target.down != 0:
                lower(row, at + target.down, z, nearest)
                if target.right != 0:
                    lower(row, at + target.down + target.right, z, nearest)
        sub += 1


@wp.func
def scale_of(brightest: wp.array2d(dtype=wp.int32), keyframe: int, env: int):
    """1 over the power of two above the keyframe's values, times HALF."""
    return HALF * wp.pow(wp.float64(2.0), wp.float64(126 - brightest[keyframe, env]))


@wp.func
def add(
    row: int, at: int, z: wp.float32, weight: int, env: int, pixel: int, scale: wp.float64,
    image: wp.array3d(dtype=wp.float32), nearest: wp.array2d(dtype=wp.float32),
    high: wp.array3d(dtype=wp.int64), low: wp.array3d(dtype=wp.int64), weights: wp.array2d(dtype=wp.int64),
):  # fmt: skip
    if weight > 0 and z * SAME_SURFACE <= nearest[row, at]:
        total = wp.int64(weight)
        for c in range(image.shape[2]):
            value = image[env, pixel, c]
            if wp.isfinite(value):
                share = wp.float64(value) * scale
                whole = wp.floor(share)
                wp.atomic_add(high, row, at, c, wp.int64(weight) * wp.int64(whole))
                wp.atomic_add(low, row, at, c, wp.int64(weight) * wp.int64(wp.floor((share - whole) * HALF)))
            else:
                total = BROKEN
        wp.atomic_add(weights, row, at, total)


@wp.kernel
def add_all(
    # in
    first: int,
    rows: int,
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
    index, pixel = wp.tid()
    subs = upsampling - 1
    env = first // subs + index
    if moves[env, pixel][3] == STAYS:
        return
    scale = scale_of(brightest, backward, env)
    sub = wp.max(first, env * subs)
    end = wp.min(first + rows, env * subs + subs)
    while sub < end:
        row = sub - first
        a = fraction(sub, upsampling, backward)
        source = bent(source_of(moves, env, pixel, width), a, env, bends)
        target = target_of(source, a, width, height)
        if target.at >= 0:
            z = source.z + a * source.dz
            gx = SUBPIXEL - target.fx
            gy = SUBPIXEL - target.fy
            # A loop that is not unrolled, or the code of four targets is in the way of all else.
            tap = wp.int32(0)
            while tap < 4:
                at = target.at + wp.where((tap & 1) == 1, target.right, 0) + wp.where(tap > 1, target.down, 0)
                wx = wp.where((tap & 1) == 1, target.fx, gx)
                wy = wp.where(tap > 1, target.fy, gy)
                add(row, at, z, wx * wy, env, pixel, scale, image, nearest, high, low, weights)
                tap += 1
        sub += 1


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
        if total == wp.int64(0) or (total >= ROOM and total < BROKEN):
            for c in range(frames.shape[2]):
                frames[frame, pixel, c] = image[env, pixel, c]
        else:
            scale = scale_of(brightest, backward, env)
            for c in range(frames.shape[2]):
                value = wp.float64(high[row, at, c]) + wp.float64(low[row, at, c]) / HALF
                weight = wp.float64(total)
                if stays:
                    own = wp.float64(SUBPIXEL) * wp.float64(SUBPIXEL)
                    value += own * wp.float64(image[env, pixel, c]) * scale
                    weight += own
                if total >= BROKEN:
                    frames[frame, pixel, c] = float(wp.nan)
                else:
                    frames[frame, pixel, c] = wp.float32(value / (weight * scale))
        if total != wp.int64(0):
            for c in range(frames.shape[2]):
                high[row, at, c] = wp.int64(0)
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
