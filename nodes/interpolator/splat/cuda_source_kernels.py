"""Makes sources that move of a keyframe's pixels: the first part of the warp on a GPU.

Values are whole numbers from here on, for their sums do not depend on the order: 56 bits below the power of two above
the keyframe's brightest, in two parts, of which the lower one is 0 for all but dark pixels.

Kernels over many pixels take their index apart themselves: Warp does that in 64 bits, which takes as long as the rest.
"""

from typing import Any

import warp as wp

from nodes.interpolator.splat.warp_kernels import EMPTY, can_land, known_depth, padded, source_of, stays_put

wp.set_module_options({"enable_backward": False})

HIGH_BITS = wp.constant(wp.int64(30))
LOW = wp.constant(wp.float64(2.0**26))
LOW_BITS = wp.constant(wp.int64(26))
BROKEN = wp.constant(wp.int64(-(2**63)))
"""Of a value that is not finite."""
STAYS = wp.constant(2.0e38)
"""dz of a source that does not move, or has no tap because its motion is not finite."""
EXPONENTS = wp.constant(256)
"""Exponents that a float32 can have."""
COPIES = wp.constant(16)


@wp.struct
class Sources:
    """Holds a keyframe, and its pixels as sources.

    image [E, H W, C], depth [E, H, W], motion [E, H, W, 2]; bends: px [E, H W], or of no elements; brightest [E]: the
    largest exponent of the image. values: whole numbers for the image's, 2^LOW_BITS high + low. moves [E, H W]:
    (dx, dy) in 1/4096 px, depth and its change; dz = STAYS where a pixel is no source. still, on the padded grid
    [E, ...]: the depth of what does not move, else EMPTY.
    """

    image: wp.array3d(dtype=wp.float32)
    depth: wp.array3d(dtype=wp.float32)
    motion: wp.array4d(dtype=wp.float32)
    bends: wp.array2d(dtype=wp.vec2)
    brightest: wp.array(dtype=wp.int32)
    values: wp.array3d(dtype=wp.int64)
    moves: wp.array2d(dtype=wp.vec4)
    still: wp.array2d(dtype=wp.float32)


@wp.func
def exponent_of(value: wp.float32):
    """Reads the exponent e of a finite value; 2^(e - 126) is the least power of two above |value|."""
    return wp.int32((wp.cast(value, wp.uint32) >> wp.uint32(23)) & wp.uint32(255))


@wp.func
def note(value: wp.float32, env: int, copy: int, seen: wp.array2d(dtype=wp.int32)):
    """Marks the exponent of a finite value as seen."""
    e = exponent_of(value) + copy * EXPONENTS
    if wp.isfinite(value) and seen[env, e] == 0:
        seen[env, e] = 1


@wp.func
def note(value: wp.vec3, env: int, copy: int, seen: wp.array2d(dtype=wp.int32)):  # noqa: F811 - overloaded by its type
    for c in range(3):
        note(value[c], env, copy, seen)


@wp.kernel
def take(
    # in
    image: wp.array3d(dtype=Any),
    depth: wp.array3d(dtype=wp.float32),
    motion: wp.array4d(dtype=wp.float32),
    # out
    own_image: wp.array3d(dtype=Any),
    own_depth: wp.array3d(dtype=wp.float32),
    own_motion: wp.array4d(dtype=wp.float32),
    last: wp.array4d(dtype=Any),
    seen: wp.array2d(dtype=wp.int32),
):
    """Copies a keyframe to where recorded launches read it and to the last frame, and marks its values' exponents.

    seen [E, COPIES EXPONENTS]: 1 for each there is, in several copies, for all threads write to the same few.
    """
    i = wp.tid()
    x = i % depth.shape[2]
    y = i // depth.shape[2] % depth.shape[1]
    env = i // (depth.shape[1] * depth.shape[2])
    value = image[env, y, x]
    own_image[env, y, x] = value
    last[env, last.shape[1] - 1, y, x] = value
    own_depth[env, y, x] = depth[env, y, x]
    own_motion[env, y, x, 0] = motion[env, y, x, 0]
    own_motion[env, y, x, 1] = motion[env, y, x, 1]
    note(value, env, (x // 32 + y) % COPIES, seen)


@wp.kernel
def find_brightest(
    # in
    seen: wp.array2d(dtype=wp.int32),
    # out
    brightest: wp.array(dtype=wp.int32),
):
    """Finds the largest exponent of each environment."""
    env, e = wp.tid()
    if seen[env, e] != 0:
        wp.atomic_max(brightest, env, e % EXPONENTS)


@wp.func
def scale_of(brightest: int):
    """Computes 2^HIGH_BITS over the power of two above the keyframe's values."""
    return wp.cast((wp.int64(1149 - brightest) + HIGH_BITS) << wp.int64(52), wp.float64)


@wp.func
def place_source(
    s: Sources,
    other: Sources,
    sign: wp.float32,
    holds: int,
    env: int,
    y: int,
    x: int,
    lost: wp.array(dtype=wp.int32),
):
    """Makes a source of a pixel of `s`, which moves towards the keyframe `other`, and whole numbers of its values.

    sign: +1 for B, -1 for A; holds: 1 where all of the environment is B; lost: counts sources without finite motion.
    """
    pixel = y * s.depth.shape[2] + x
    dx = sign * s.motion[env, y, x, 0]
    dy = sign * s.motion[env, y, x, 1]
    z = s.depth[env, y, x]
    own = known_depth(z)
    move = wp.vec4(0.0, 0.0, own, STAYS)
    straight = wp.bool(True)
    if s.bends.shape[1] > 0:
        straight = s.bends[env, pixel][0] == 0.0 and s.bends[env, pixel][1] == 0.0
    stays = stays_put(holds, straight, dx, dy, z, other.depth[env, y, x])
    s.still[env, padded(pixel, s.depth.shape[2])] = wp.where(stays, own, EMPTY)
    if not stays:
        if can_land(dx, dy):
            source = source_of(other.depth, env, x, y, pixel, dx, dy, own)
            move = wp.vec4(source.dx, source.dy, source.z, source.dz)
        elif not (wp.isfinite(dx) and wp.isfinite(dy)):
            wp.atomic_add(lost, 0, 1)
    s.moves[env, pixel] = move
    scale = scale_of(s.brightest[env])
    for c in range(s.image.shape[2]):
        value = s.image[env, pixel, c]
        whole = BROKEN
        if wp.isfinite(value):
            share = wp.float64(value) * scale
            floor = wp.floor(share)
            whole = (wp.int64(floor) << LOW_BITS) + wp.int64(wp.floor((share - floor) * LOW))
        s.values[env, pixel, c] = whole


@wp.kernel
def locate(
    # in
    held: wp.array(dtype=wp.int32),
    from_a: Sources,
    from_b: Sources,
    # out
    lost: wp.array(dtype=wp.int32),
):
    """Makes sources of the pixels of both keyframes: B's go back along their motion, A's go on along theirs."""
    i = wp.tid()
    height = from_a.depth.shape[1]
    width = from_a.depth.shape[2]
    x = i % width
    y = i // width % height
    env = i // (width * height) % from_a.depth.shape[0]
    backward = i // (width * height * from_a.depth.shape[0])
    if backward != 0:
        place_source(from_b, from_a, 1.0, held[env], env, y, x, lost)
    else:
        place_source(from_a, from_b, -1.0, held[env], env, y, x, lost)
