"""Computes luminance and means of samples on whole images, and tells a pixel's type, as every method needs them."""

from typing import Any

import warp as wp

from nodes.renderer.shading.radiance_kernels import luminance as luminance_of_colour

wp.set_module_options({"enable_backward": False})


def pixel_type(channels: int) -> Any:
    """Gives the type of a pixel's light, or of its logarithm. channels: 1 (luminance) or 3 (RGB)."""
    return wp.float32 if channels == 1 else wp.vec3


@wp.kernel
def luminance(
    # in
    radiance: wp.array2d(dtype=Any),
    # out
    image: wp.array(dtype=wp.float32),
):
    """Computes the luminance of pixels [N, 3], equation (3); that of float16 is rounded to float16, as the renderer's
    own is."""
    i = wp.tid()
    red = radiance[i, 0]
    value = luminance_of_colour(wp.vec3(wp.float32(red), wp.float32(radiance[i, 1]), wp.float32(radiance[i, 2])))
    image[i] = wp.float32(type(red)(value))


for _scalar in (wp.float16, wp.float32):  # both at once: one that is found later would have all compiled again
    wp.overload(luminance, {"radiance": wp.array2d(dtype=_scalar)})


@wp.kernel
def mean(
    # in
    samples: int,
    channels: int,
    fine: wp.array3d(dtype=wp.float32),
    # out
    frames: wp.array3d(dtype=wp.float32),
):
    """Averages samples x samples pixels of fine [R, samples h, samples w C] into frames [R, h, w C] of C channels."""
    row, y = wp.tid()
    x = wp.int32(0)
    while x < frames.shape[2]:
        first = x // channels * channels * samples + x % channels
        total = wp.float32(0.0)
        for j in range(samples):
            for i in range(samples):
                total += fine[row, y * samples + j, first + i * channels]
        frames[row, y, x] = total / float(samples * samples)
        x += 1
