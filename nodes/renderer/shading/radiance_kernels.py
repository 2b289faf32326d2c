"""Writes light out of a kernel: as RGB, as luminance or as both; what is not finite, or too large, is counted."""

from functools import cache
from typing import Any

import warp as wp

from evis.media.colour import REC709

wp.set_module_options({"enable_backward": False})

LARGEST_HALF = wp.constant(65504.0)
"""The largest float16."""

_RED, _GREEN, _BLUE = (f"{weight}f" for weight in REC709)
LUMINANCE = f"""
#if defined(__CUDA_ARCH__)
    const float red_green = __fadd_rn(__fmul_rn({_RED}, colour[0]), __fmul_rn({_GREEN}, colour[1]));
    return __fadd_rn(red_green, __fmul_rn({_BLUE}, colour[2]));
#else
#pragma clang fp contract(off)
    return {_RED} * colour[0] + {_GREEN} * colour[1] + {_BLUE} * colour[2];
#endif
"""


@wp.func_native(LUMINANCE)
def luminance(colour: wp.vec3) -> float:
    """Computes I = 0.2126 R + 0.7152 G + 0.0722 B, equation (3), with one rounding for each operation.

    A compiler would fuse a product and a sum here and there as the code around it has it. Without that, luminance that
    the renderer takes of a pixel has the same bits as what the interpolator takes of the same pixel's radiance.
    """
    ...


@wp.func
def finite(value: float, largest: float):
    """Replaces an infinite value by the largest one, and what is not a number by 0."""
    if wp.isfinite(value):
        return value
    return wp.where(value > 0.0, largest, 0.0)


@cache
def make_image(half: bool) -> Any:
    """Makes the struct of what an image of light is written to; radiance or luminance [E, H, W] may have no elements.

    Counts are int32 [bands]. half: float16, of which luminance is that of the rounded channels, rounded once more.
    """
    pixel, scalar = (wp.vec3h, wp.float16) if half else (wp.vec3f, wp.float32)

    class Image:
        radiance: wp.array3d(dtype=pixel)  # type: ignore[valid-type]
        luminance: wp.array3d(dtype=scalar)  # type: ignore[valid-type]
        not_finite: wp.array(dtype=int)
        clipped: wp.array(dtype=int)

    Image.__qualname__ = f"Image{'Half' if half else ''}"
    return wp.struct(Image)


@cache
def make_write(half: bool) -> Any:
    """Makes the function that writes a pixel; half: as float16, clipped and counted at its largest."""
    Image: Any = make_image(half)
    largest = 65504.0 if half else 3.0e38

    @wp.func
    def write(env: int, y: int, x: int, band: int, value: wp.vec3, image: Image):
        """Writes a pixel as RGB, as luminance or as both; counts it if it is not finite or too large."""
        colour = value
        if not (wp.isfinite(colour[0]) and wp.isfinite(colour[1]) and wp.isfinite(colour[2])):
            wp.atomic_add(image.not_finite, band, 1)
            most = wp.static(largest)
            colour = wp.vec3(finite(colour[0], most), finite(colour[1], most), finite(colour[2], most))
        if wp.static(half):
            if wp.max(colour) > LARGEST_HALF:
                wp.atomic_add(image.clipped, band, 1)
                colour = wp.min(colour, wp.vec3(LARGEST_HALF, LARGEST_HALF, LARGEST_HALF))
            rounded = wp.vec3h(wp.float16(colour[0]), wp.float16(colour[1]), wp.float16(colour[2]))
            if image.radiance.shape[0] > 0:
                image.radiance[env, y, x] = rounded
            if image.luminance.shape[0] > 0:
                image.luminance[env, y, x] = wp.float16(luminance(wp.vec3(rounded)))
        else:
            if image.radiance.shape[0] > 0:
                image.radiance[env, y, x] = colour
            if image.luminance.shape[0] > 0:
                image.luminance[env, y, x] = luminance(colour)

    return write


@cache
def make_mean(half: bool) -> wp.Kernel:
    """Makes the kernel of a pixel's light, the mean of its n x n samples."""
    Image: Any = make_image(half)
    write = make_write(half)

    @wp.kernel(module="unique", enable_backward=False)
    def mean(
        # in
        n: int,
        fine: wp.array3d(dtype=wp.vec3),
        # out
        image: Image,
    ):
        """Averages n x n samples of every pixel of fine [E, n H, n W]."""
        env, y, x = wp.tid()
        total = wp.vec3(0.0, 0.0, 0.0)
        for j in range(n):
            for i in range(n):
                # Divided first, for the sum of large ones would overflow.
                total += fine[env, y * n + j, x * n + i] / float(n * n)
        write(env, y, x, 0, total, image)

    return mean
