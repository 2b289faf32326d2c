"""Gathers what a lobe reflects of a map of the sky, on a CPU: several samples at a time, in C++.

Warp's own code takes one sample after another, and calls the C library for each.
"""

from pathlib import Path

import warp as wp

from evis.native_code import native_code

wp.set_module_options({"enable_backward": False})

RUN = 8
"""Samples that are taken at a time, as in specular_means.h."""
BESIDE = 1
"""Texels that must follow the last one of a map: specular_means.h reads two numbers beyond it."""
SPECULAR_MEANS = Path(__file__).with_name("specular_means.h")
GATHER = "return specular_means(points, levels, texels, to_world, view, alpha, held, stretched, widest);"

Means = wp.types.matrix(shape=(2, 3), dtype=wp.float32)
"""Two means of the radiance of a map, as rows."""


@wp.func_native(native_code([SPECULAR_MEANS], GATHER))
def specular_means_by_runs(
    points: wp.array2d(dtype=wp.float32),
    levels: wp.array(dtype=wp.vec3i),
    texels: wp.array(dtype=wp.vec3),
    to_world: wp.mat33,
    view: wp.vec2,
    alpha: float,
    held: float,
    stretched: wp.vec3,
    widest: float,
) -> Means:
    """Computes the same means as `sky_kernels.specular_means_by_sample`, in C++ with several samples at a time."""
    ...
