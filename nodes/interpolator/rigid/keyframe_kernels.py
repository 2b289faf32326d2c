"""Prepares what of a keyframe is looked up at every sub-frame: log radiance, patches, inverse distances, where all is
whole."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.rigid.look_up.log_kernels import apart, fused_luminance, log_type
from nodes.interpolator.rigid.patch_kernels import patch_of
from nodes.renderer.raster.depth_kernels import MISS, NO_ENTRY, depth_of, triangle_of

wp.set_module_options({"enable_backward": False})


DARKEST = wp.constant(1.0e-30)
"""Radiance below which the logarithm is that of this one."""
UNUSABLE = wp.constant(-1)
"""Patch of a pixel whose radiance is not finite."""
JUMP = wp.constant(3.0e-3)
"""Second difference of the inverse distance, of the inverse distance, from which on a patch hides a part of itself.

Over a plane the inverse distance is linear in the pixel; over a sphere of radius R at z it bends by z / (f^2 R)."""
OVER_SECOND = wp.constant(0.125)
"""Greatest difference of cubic convolution from linear interpolation along a line, of the second differences beside:
f (1 - f) / 2 times their mean by f, from the weights of Keys (1981)."""
GAIN = wp.constant(1.25)
"""Greatest sum of the magnitudes of cubic convolution's weights."""
WHOLE = wp.constant(1)
STRAIGHT = wp.constant(2)
"""Bits of `support`."""


@wp.func
def log_of(value: wp.float32):
    """Computes ln of radiance, held at that of DARKEST; in RGB of each channel."""
    return wp.log(wp.max(value, DARKEST))


@wp.func
def log_of(value: wp.vec3):  # noqa: F811 - overloaded by its type
    return wp.vec3(
        wp.log(wp.max(value[0], DARKEST)), wp.log(wp.max(value[1], DARKEST)), wp.log(wp.max(value[2], DARKEST))
    )


@wp.func
def usable(value: wp.float32):
    """Tells whether radiance is finite; in RGB whether all channels are."""
    return wp.isfinite(value)


@wp.func
def usable(value: wp.vec3):  # noqa: F811 - overloaded by its type
    return wp.isfinite(value[0]) and wp.isfinite(value[1]) and wp.isfinite(value[2])


@wp.func
def texel_of(patch: int, nearness: float, log: wp.float32):
    """Packs what is read of a pixel at once: the bits of its patch, inverse distance and, of luminance, its ln."""
    return wp.vec4(wp.cast(patch, wp.float32), nearness, log, 0.0)


@wp.func
def texel_of(patch: int, nearness: float, log: Any):  # noqa: F811 - overloaded by its type
    return wp.vec4(wp.cast(patch, wp.float32), nearness, 0.0, 0.0)


@wp.func
def patch_at(hit: wp.uint64, pieces: wp.array(dtype=wp.vec2i)):
    """Gives the patch (0 = sky) and inverse distance [1/m] (0 = sky) of what a pixel shows."""
    t = triangle_of(hit)
    if t == MISS:
        return 0, 0.0
    return patch_of(hit, pieces[t]), 1.0 / depth_of(hit)


@wp.kernel
def prepare_pixels(
    # in
    span: int,
    packed: wp.array3d(dtype=wp.uint64),
    pieces: wp.array(dtype=wp.vec2i),
    image: wp.array3d(dtype=Any),
    # out
    logs: wp.array3d(dtype=Any),
    patch: wp.array3d(dtype=int),
    inverse: wp.array3d(dtype=float),
    texels: wp.array3d(dtype=wp.vec4),
    nonfinite: wp.array(dtype=int),
):
    """Computes log radiance, patch (0 = sky) and inverse distance [1/m] (0 = sky) of every pixel; `span` pixels a
    thread."""
    env, y, part = wp.tid()
    for x in range(part * span, wp.min(part * span + span, packed.shape[2])):
        p, w = patch_at(packed[env, y, x], pieces)
        value = image[env, y, x]
        if not usable(value):
            p = UNUSABLE
            wp.atomic_add(nonfinite, 0, 1)
        log = log_of(value)
        logs[env, y, x] = log
        texels[env, y, x] = texel_of(p, w, log)
        patch[env, y, x] = p
        inverse[env, y, x] = w


@cache
def make_prepare_flickering(channels: int, waveform_count: int) -> wp.Kernel:
    """Makes the kernel that does what `prepare_pixels` does where lights flicker; arguments as of `log_type`."""
    pixel: Any = log_type(channels, 0)
    logs_type: Any = log_type(channels, waveform_count)

    @wp.kernel(module="unique", enable_backward=False)
    def prepare_flickering(
        # in
        span: int,
        packed: wp.array3d(dtype=wp.uint64),
        pieces: wp.array(dtype=wp.vec2i),
        image: wp.array3d(dtype=pixel),
        lights: wp.array4d(dtype=wp.vec3),
        # out
        logs: wp.array3d(dtype=logs_type),
        patch: wp.array3d(dtype=int),
        inverse: wp.array3d(dtype=float),
        texels: wp.array3d(dtype=wp.vec4),
        nonfinite: wp.array(dtype=int),
    ):
        """Computes what prepare_pixels does, of the radiance `lights` [waveforms + 1, E, H, W] under those of each
        waveform at their mean beside the steady ones, and under these alone."""
        env, y, part = wp.tid()
        for x in range(part * span, wp.min(part * span + span, packed.shape[2])):
            p, w = patch_at(packed[env, y, x], pieces)
            right = usable(image[env, y, x])
            log = logs_type()
            for k in range(wp.static(waveform_count + 1)):
                colour = lights[k, env, y, x]
                right = right and usable(colour)
                if wp.static(channels == 1):
                    log[k] = log_of(fused_luminance(colour))
                else:
                    for channel in range(3):
                        log[3 * k + channel] = log_of(colour[channel])
            if not right:
                p = UNUSABLE
                wp.atomic_add(nonfinite, 0, 1)
            logs[env, y, x] = log
            texels[env, y, x] = texel_of(p, w, log)
            patch[env, y, x] = p
            inverse[env, y, x] = w

    return prepare_flickering


@wp.func
def bends(a: float, b: float, c: float):
    """Tells whether three inverse distances in a row are too far from linear."""
    return wp.abs(a - 2.0 * b + c) > JUMP * b


@wp.func
def one_patch(patch: wp.array3d(dtype=int), env: int, y: int, x: int):
    """Tells whether the 4 x 4 pixels from (x - 1, y - 1) on belong to one patch."""
    p = patch[env, y, x]
    for r in range(-1, 3):
        if patch[env, y + r, x - 1] != p or patch[env, y + r, x] != p:
            return False
        if patch[env, y + r, x + 1] != p or patch[env, y + r, x + 2] != p:
            return False
    return True


@wp.func
def one_sheet(w: wp.array3d(dtype=float), env: int, y: int, x: int):
    """Tells whether the inverse distance changes smoothly over the 4 x 4 pixels from (x - 1, y - 1) on."""
    for r in range(-1, 3):
        j = y + r
        if bends(w[env, j, x - 1], w[env, j, x], w[env, j, x + 1]) or bends(
            w[env, j, x], w[env, j, x + 1], w[env, j, x + 2]
        ):
            return False
        i = x + r
        if bends(w[env, y - 1, i], w[env, y, i], w[env, y + 1, i]) or bends(
            w[env, y, i], w[env, y + 1, i], w[env, y + 2, i]
        ):
            return False
    return True


@wp.func
def second(logs: wp.array3d(dtype=Any), env: int, y: int, x: int, down: int, right: int):
    """Computes the magnitude of the second difference of log radiance at a pixel, along a row or a column."""
    here = logs[env, y, x]
    return apart(logs[env, y - down, x - right] - here, here - logs[env, y + down, x + right])


@wp.func
def straight(logs: wp.array3d(dtype=Any), env: int, y: int, x: int, limit: float):
    """Tells whether cubic convolution between the pixels x, x + 1 and y, y + 1 differs by `limit` from linear
    interpolation at most."""
    along = wp.float32(0.0)
    across = wp.float32(0.0)
    for i in range(2):
        for r in range(-1, 3):
            along = wp.max(along, second(logs, env, y + r, x + i, 0, 1))
        for r in range(2):
            across = wp.max(across, second(logs, env, y + i, x + r, 1, 0))
    return OVER_SECOND * (GAIN * along + across) <= limit


@wp.kernel
def find_support(
    # in
    span: int,
    limit: float,
    moving: wp.array(dtype=int),
    patch: wp.array3d(dtype=int),
    inverse: wp.array3d(dtype=float),
    logs: wp.array3d(dtype=Any),
    # out
    support: wp.array3d(dtype=int),
):
    """Computes what of a patch is seen about a place between the pixels x, x + 1 and y, y + 1.

    4 patch + WHOLE where all of the 4 x 4 pixels from (x - 1, y - 1) on belong to it and it hides no part of itself
    there, and + STRAIGHT where ln I is linear between the four besides, but for `limit` if that is not negative; 4
    patch where the four belong to it, else UNUSABLE. Of what never moves nothing is looked for between the pixels.
    """
    env, y, part = wp.tid()
    height = patch.shape[1]
    width = patch.shape[2]
    for x in range(part * span, wp.min(part * span + span, width)):
        code = UNUSABLE
        if x >= 1 and y >= 1 and x + 2 < width and y + 2 < height:
            p = patch[env, y, x]
            if (
                p >= 0
                and moving[wp.max(p, 0)] == 1
                and patch[env, y, x + 1] == p
                and patch[env, y + 1, x] == p
                and patch[env, y + 1, x + 1] == p
            ):
                code = 4 * p
                if one_patch(patch, env, y, x) and (p == 0 or one_sheet(inverse, env, y, x)):
                    code += WHOLE
                    if limit >= 0.0 and straight(logs, env, y, x, limit):
                        code += STRAIGHT
        support[env, y, x] = code


HELD = wp.constant(2)


@wp.func
def equal(a: wp.float32, b: wp.float32):
    """Tells whether two pixels are equal."""
    return a == b


@wp.func
def equal(a: wp.vec3, b: wp.vec3):  # noqa: F811 - overloaded by its type
    return a[0] == b[0] and a[1] == b[1] and a[2] == b[2]


@wp.kernel
def find_unchanged(
    # in
    span: int,
    packed_a: wp.array3d(dtype=wp.uint64),
    packed_b: wp.array3d(dtype=wp.uint64),
    image_a: wp.array3d(dtype=Any),
    image_b: wp.array3d(dtype=Any),
    pieces: wp.array(dtype=wp.vec2i),
    still: wp.array2d(dtype=int),
    # out
    unchanged: wp.array3d(dtype=wp.uint64),
):
    """Computes the z-buffer entry with which a pixel shows what it does in both keyframes, or NO_ENTRY where that has
    changed.

    still [E, N + 2]: 1 for bodies, the world and the sky that do not move against the camera at any sub-frame of the
    gap; HELD for all of an environment that is to be B throughout.
    """
    env, y, part = wp.tid()
    sky = still.shape[1] - 1
    for x in range(part * span, wp.min(part * span + span, packed_b.shape[2])):
        hit = packed_b[env, y, x]
        entry = NO_ENTRY
        if still[env, sky] == HELD:
            entry = hit
        elif hit == packed_a[env, y, x] and equal(image_a[env, y, x], image_b[env, y, x]):
            t = triangle_of(hit)
            body = sky
            if t != MISS:
                body = pieces[t][0]
            if still[env, body] == 1:
                entry = hit
        unchanged[env, y, x] = entry
