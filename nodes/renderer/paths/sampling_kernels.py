"""Draws random numbers that are frozen on surfaces, and directions to the sky and over a hemisphere."""

import warp as wp

from nodes.renderer.lights.area_sample_kernels import LATTICE, cell_key
from nodes.renderer.materials.ggx_kernels import PI

wp.set_module_options({"enable_backward": False})


CELLS = wp.constant(0.5)
"""Cells of the random numbers along an instance's radius."""

TURNS = wp.constant(2.0)
"""How often the numbers go round within a cell's neighbourhood, which makes them nearly uniform over a surface."""

SPLIT = wp.constant(-0.74)
"""Height of a normal in its instance's frame below which the frame of directions about it is another one. At 0, where
it often is set, lie the sides of boxes and cylinders: rounding chose between two frames, and their light flickered."""

EMITTER = wp.constant(1)
LIGHT_PROXY = wp.constant(2)
"""An instance whose emission is light of its own; one that only shows a light, whose light is counted there."""


@wp.struct
class PathSources:
    """Holds what light comes from apart from lights, with the sums by which it is chosen.

    Glowing triangles, G of them: emitter_cdf [G] by luminous power; emitter_instance [G]; emitter_corners [G, 3] in
    the instance's frame; emitter_density: density per area of a unit of luminance [1/W]. emitter_kind [I]: EMITTER,
    LIGHT_PROXY, or 0 for what does not emit.

    Sky map: sky_row_cdf [h]; sky_column_cdf [h, w], of each row; sky_pdf [h, w] share of a texel times the number of
    texels.
    """

    emitter_cdf: wp.array(dtype=float)
    emitter_instance: wp.array(dtype=int)
    emitter_corners: wp.array2d(dtype=wp.vec3)
    emitter_density: float
    emitter_kind: wp.array(dtype=int)
    sky_row_cdf: wp.array(dtype=float)
    sky_column_cdf: wp.array2d(dtype=float)
    sky_pdf: wp.array2d(dtype=float)


@wp.struct
class Sampler:
    """Holds what the random numbers of a path depend on: that it is sample k of `count`, and where it begins, a point
    of an instance with `shift` (`frozen_shift`)."""

    k: int
    count: int
    instance: int
    shift: wp.vec4


@wp.func
def fraction(x: float):
    """Gives the fraction of x, below 1 also after rounding."""
    return wp.min(x - wp.floor(x), 0.99999994)


@wp.func
def lattice_numbers(i: int, j: int, k: int, instance: int):
    """Gives four random numbers of a lattice point of an instance."""
    state = wp.rand_init(int(cell_key(wp.uint32(i), wp.uint32(j), wp.uint32(k), instance)), 17)
    return wp.vec4(wp.randf(state), wp.randf(state), wp.randf(state), wp.randf(state))


@wp.func
def frozen_shift(q: wp.vec3, radius: float, instance: int):
    """Gives four numbers in [0, 1) that belong to the point q of an instance's frame, whatever looks at it.

    They vary smoothly over the surface, round the end of the range, between random ones at the corners of its cells.
    """
    r = (LATTICE * q) * (CELLS / wp.max(radius, 1.0e-30))
    i = int(wp.floor(r[0]))
    j = int(wp.floor(r[1]))
    k = int(wp.floor(r[2]))
    x = r[0] - float(i)
    y = r[1] - float(j)
    z = r[2] - float(k)
    x = x * x * (3.0 - 2.0 * x)
    y = y * y * (3.0 - 2.0 * y)
    z = z * z * (3.0 - 2.0 * z)
    total = wp.vec4(0.0, 0.0, 0.0, 0.0)
    for c in range(8):
        dx = c & 1
        dy = (c >> 1) & 1
        dz = c >> 2
        weight = wp.where(dx == 1, x, 1.0 - x) * wp.where(dy == 1, y, 1.0 - y) * wp.where(dz == 1, z, 1.0 - z)
        total += weight * lattice_numbers(i + dx, j + dy, k + dz, instance)
    total = TURNS * total
    return wp.vec4(fraction(total[0]), fraction(total[1]), fraction(total[2]), fraction(total[3]))


@wp.func
def radical_inverse(k: int):
    """Gives the radical inverse of k in base 2."""
    b = wp.uint32(k)
    b = (b << wp.uint32(16)) | (b >> wp.uint32(16))
    b = ((b >> wp.uint32(1)) & wp.uint32(0x55555555)) | ((b & wp.uint32(0x55555555)) << wp.uint32(1))
    b = ((b >> wp.uint32(2)) & wp.uint32(0x33333333)) | ((b & wp.uint32(0x33333333)) << wp.uint32(2))
    b = ((b >> wp.uint32(4)) & wp.uint32(0x0F0F0F0F)) | ((b & wp.uint32(0x0F0F0F0F)) << wp.uint32(4))
    b = ((b >> wp.uint32(8)) & wp.uint32(0x00FF00FF)) | ((b & wp.uint32(0x00FF00FF)) << wp.uint32(8))
    return float(b) * 2.3283064e-10


@wp.func
def sample_square(sampler: Sampler, bounce: int, shift: wp.vec2):
    """Gives a path's point in the unit square, moved round by `shift` (Cranley and Patterson, 1976).

    Where a path begins these are Hammersley's points; further on, fixed random ones.
    """
    x = (float(sampler.k) + 0.5) / float(sampler.count)
    y = wp.float32(0.0)
    if bounce == 0:
        y = radical_inverse(sampler.k)
    else:
        state = wp.rand_init(sampler.instance * 7919 + bounce, sampler.k)
        x = wp.randf(state)
        y = wp.randf(state)
    return wp.vec2(fraction(x + shift[0]), fraction(y + shift[1]))


@wp.func
def cosine_direction(n: wp.vec3, rotation: wp.mat33, u: wp.vec2):
    """Gives a direction about the normal n with density cosine / pi.

    The frame about n is made in the instance's frame and so turns with it (Duff et al., JCGT 6(1), 2017).
    """
    m = wp.transpose(rotation) * n
    sign = wp.where(m[2] >= SPLIT, 1.0, -1.0)
    a = -1.0 / (sign + m[2])
    b = m[0] * m[1] * a
    t = rotation * wp.vec3(1.0 + sign * m[0] * m[0] * a, sign * b, -sign * m[0])
    s = rotation * wp.vec3(b, sign + m[1] * m[1] * a, -m[1])
    phi = 2.0 * PI * u[1]
    r = wp.sqrt(u[0])
    return wp.normalize(r * wp.cos(phi) * t + r * wp.sin(phi) * s + wp.sqrt(wp.max(1.0 - u[0], 0.0)) * n)


@wp.func
def search_cdf(cdf: wp.array(dtype=float), u: float):
    """Finds the first entry of a cumulative distribution that is above u, by bisection."""
    low = wp.int32(0)
    high = cdf.shape[0] - 1
    while low < high:
        middle = (low + high) // 2
        if cdf[middle] > u:
            high = middle
        else:
            low = middle + 1
    return low


@wp.func
def place_in_entry(cdf: wp.array(dtype=float), index: int, u: float):
    """Finds where u lies within its entry of a cumulative distribution, in [0, 1): what is left of it is uniform."""
    before = wp.float32(0.0)
    if index > 0:
        before = cdf[index - 1]
    return wp.clamp((u - before) / wp.max(cdf[index] - before, 1.0e-30), 0.0, 0.99999994)


@wp.func
def sky_direction(sources: PathSources, u: wp.vec2):
    """Gives a world direction towards a bright part of the map."""
    h = sources.sky_row_cdf.shape[0]
    row = search_cdf(sources.sky_row_cdf, u[0])
    y = float(row) + place_in_entry(sources.sky_row_cdf, row, u[0])
    cdf = sources.sky_column_cdf[row]
    column = search_cdf(cdf, u[1])
    x = float(column) + place_in_entry(cdf, column, u[1])
    theta = y / float(h) * PI
    phi = x / float(cdf.shape[0]) * 2.0 * PI
    return wp.vec3(wp.sin(theta) * wp.cos(phi), wp.sin(theta) * wp.sin(phi), wp.cos(theta))


@wp.func
def sky_density(sources: PathSources, d: wp.vec3):
    """Gives the density [1/sr] with which `sky_direction` gives d."""
    h = sources.sky_pdf.shape[0]
    w = sources.sky_pdf.shape[1]
    sine = wp.sqrt(d[0] * d[0] + d[1] * d[1])
    azimuth = wp.atan2(d[1], d[0]) / (2.0 * PI)
    azimuth = azimuth - wp.floor(azimuth)
    row = wp.clamp(int(wp.atan2(sine, d[2]) / PI * float(h)), 0, h - 1)
    column = wp.clamp(int(azimuth * float(w)), 0, w - 1)
    return sources.sky_pdf[row, column] / (2.0 * PI * PI * wp.max(sine, 1.0e-6))
