"""Textures: bilinear where magnified, mipmaps along the footprint of the pixel where minified."""

import warp as wp

wp.set_module_options({"enable_backward": False})

TAPS = wp.constant(8)
"""Most samples along a footprint; one longer than 8 of its widths is blurred across."""


@wp.struct
class Textures:
    """Holds all textures. texels: the levels of all textures one after another, row by row from v = 1 downwards.

    levels: (first texel, width, height) of each level. place [I]: (first level, number of levels) of an instance's
    texture; 0 levels = none.
    """

    texels: wp.array(dtype=wp.vec3)
    levels: wp.array(dtype=wp.vec3i)
    place: wp.array(dtype=wp.vec2i)


@wp.func
def wrap(i: int, n: int):
    """Gives texel -1 ... n of a row of n; a remainder would take longer than all the rest of a sample."""
    if i < 0:
        return i + n
    if i >= n:
        return i - n
    return i


@wp.func
def bilinear(texels: wp.array(dtype=wp.vec3), level: wp.vec3i, uv: wp.vec2):
    """Gives linear interpolation between texel centres ((i + 0.5) / width, 1 - (j + 0.5) / height), repeating."""
    w = level[1]
    h = level[2]
    # The whole number is taken off first, so that the fraction of a far repetition keeps its digits.
    x = (uv[0] - wp.floor(uv[0])) * float(w) - 0.5
    y = (1.0 - (uv[1] - wp.floor(uv[1]))) * float(h) - 0.5
    i = int(wp.floor(x))
    j = int(wp.floor(y))
    fx = x - float(i)
    fy = y - float(j)
    left = wrap(i, w)
    right = wrap(i + 1, w)
    above = level[0] + wrap(j, h) * w
    below = level[0] + wrap(j + 1, h) * w
    upper = texels[above + left] * (1.0 - fx) + texels[above + right] * fx
    lower = texels[below + left] * (1.0 - fx) + texels[below + right] * fx
    return upper * (1.0 - fy) + lower * fy


@wp.func
def filtered(textures: Textures, place: wp.vec2i, uv: wp.vec2, across: wp.vec2, down: wp.vec2):
    """Gives a texture under a pixel; across, down: how uv changes from one column and one row to the next.

    A footprint of at most one texel is magnified: bilinear. A longer one is covered by up to TAPS samples along the
    longer derivative, each trilinear at the level whose texels are as wide as the footprint (Schilling, Knittel and
    Strasser, Texram: A Smart Memory for Texturing, 1996).
    """
    level = textures.levels[place[0]]
    w = float(level[1])
    h = float(level[2])
    a = wp.vec2(across[0] * w, across[1] * h)
    b = wp.vec2(down[0] * w, down[1] * h)
    a2 = wp.dot(a, a)
    b2 = wp.dot(b, b)
    long2 = wp.max(a2, b2)
    if not long2 > 1.0:
        return bilinear(textures.texels, level, uv)
    length = wp.sqrt(long2)
    width = wp.max(wp.abs(a[0] * b[1] - a[1] * b[0]) / length, wp.max(length / float(TAPS), 1.0))
    taps = int(wp.ceil(length / width))
    # The outermost samples lie half a width from the ends, so that a footprint as long as wide has one place.
    axis = wp.where(a2 >= b2, across, down) * (1.0 - width / length)
    at = uv - 0.5 * axis
    step = axis / float(wp.max(taps - 1, 1))
    lod = wp.min(wp.log2(width), float(place[1] - 1))
    base = int(lod)
    share = lod - float(base)
    fine = textures.levels[place[0] + base]
    coarse = textures.levels[place[0] + wp.min(base + 1, place[1] - 1)]
    total = wp.vec3(0.0, 0.0, 0.0)
    for _ in range(taps):
        total += (1.0 - share) * bilinear(textures.texels, fine, at)
        if share > 0.0:
            total += share * bilinear(textures.texels, coarse, at)
        at += step
    return total / float(taps)
