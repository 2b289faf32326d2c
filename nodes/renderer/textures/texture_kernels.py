"""Samples textures: bilinear where magnified, mipmaps along the footprint of the pixel where minified."""

import warp as wp

wp.set_module_options({"enable_backward": False})

TAPS = wp.constant(8)
"""Most samples along a footprint; one longer than 8 of its widths is blurred across."""


@wp.struct
class Textures:
    """Holds all textures. texels: the levels of all textures one after another, row by row from v = 1 downwards; each
    red, green, blue and 0, for four numbers are read as fast as one, on a CPU as on a GPU.

    levels: (first texel, width, height) of each level. place [I]: (first level, number of levels) of an instance's
    texture; 0 levels = none.
    """

    texels: wp.array(dtype=wp.vec4)
    levels: wp.array(dtype=wp.vec3i)
    place: wp.array(dtype=wp.vec2i)


# Places are held to the level, for uv may be no number.
BILINEAR = """
    const auto held = [](int i, int n) { return i < 0 ? 0 : i < n ? i : n - 1; };
    const int w = level[1], h = level[2];
    // The whole number is taken off first, so that the fraction of a far repetition keeps its digits.
    const float x = (uv[0] - floorf(uv[0])) * (float)w - 0.5f;
    const float y = (1.0f - (uv[1] - floorf(uv[1]))) * (float)h - 0.5f;
    const float west = floorf(x), north = floorf(y);
    const float fx = x - west, fy = y - north;
    const int i = (int)west, j = (int)north;
    const int left = held(i < 0 ? i + w : i, w), right = held(i + 1 < w ? i + 1 : 0, w);
    const int above = level[0] + w * held(j < 0 ? j + h : j, h), below = level[0] + w * held(j + 1 < h ? j + 1 : 0, h);
#if defined(__CUDA_ARCH__)
    const auto at = [&](int place) {
        const float4 t = __ldg(reinterpret_cast<const float4*>(texels.data) + place);
        return wp::vec3(t.x, t.y, t.z);
    };
    const wp::vec3 upper = wp::add(at(above + left) * (1.0f - fx), at(above + right) * fx);
    const wp::vec3 lower = wp::add(at(below + left) * (1.0f - fx), at(below + right) * fx);
    return wp::add(upper * (1.0f - fy), lower * fy);
#else
    typedef float four __attribute__((ext_vector_type(4), aligned(4)));
    const auto at = [&](int place) { return *(const four*)(&texels.data[place]); };
    const four upper = at(above + left) * (1.0f - fx) + at(above + right) * fx;
    const four lower = at(below + left) * (1.0f - fx) + at(below + right) * fx;
    const four value = upper * (1.0f - fy) + lower * fy;
    return wp::vec3(value[0], value[1], value[2]);
#endif
"""


@wp.func_native(BILINEAR)
def bilinear(texels: wp.array(dtype=wp.vec4), level: wp.vec3i, uv: wp.vec2) -> wp.vec3:
    """Gives linear interpolation between texel centres ((i + 0.5) / width, 1 - (j + 0.5) / height), repeating."""
    ...


@wp.struct
class Filter:
    """Holds how a texture is filtered under a footprint.

    fine, coarse: levels between which it is interpolated, as of Textures; share: of the coarse one. taps: samples along
    the footprint; 0 = magnified. first: from the middle of the footprint to the first of these; step: to the next.
    """

    fine: wp.vec3i
    coarse: wp.vec3i
    share: float
    taps: int
    first: wp.vec2
    step: wp.vec2


@wp.func
def filter_of(textures: Textures, place: wp.vec2i, across: wp.vec2, down: wp.vec2):
    """Gives how a texture is filtered under a pixel; across, down: how uv changes from one column and one row to the
    next.

    A footprint of at most one texel is magnified: bilinear. A longer one is covered by up to TAPS samples along the
    longer derivative, each trilinear at the level whose texels are as wide as the footprint (Schilling, Knittel and
    Strasser, Texram: A Smart Memory for Texturing, 1996).
    """
    f = Filter()
    level = textures.levels[place[0]]
    w = float(level[1])
    h = float(level[2])
    a = wp.vec2(across[0] * w, across[1] * h)
    b = wp.vec2(down[0] * w, down[1] * h)
    a2 = wp.dot(a, a)
    b2 = wp.dot(b, b)
    long2 = wp.max(a2, b2)
    if not long2 > 1.0:
        f.fine = level
        return f
    length = wp.sqrt(long2)
    width = wp.max(wp.abs(a[0] * b[1] - a[1] * b[0]) / length, wp.max(length / float(TAPS), 1.0))
    f.taps = int(wp.ceil(length / width))
    # The outermost samples lie half a width from the ends, so that a footprint as long as wide has one place.
    axis = wp.where(a2 >= b2, across, down) * (1.0 - width / length)
    f.first = -0.5 * axis
    f.step = axis / float(wp.max(f.taps - 1, 1))
    lod = wp.min(wp.log2(width), float(place[1] - 1))
    base = int(lod)
    f.share = lod - float(base)
    f.fine = textures.levels[place[0] + base]
    f.coarse = textures.levels[place[0] + wp.min(base + 1, place[1] - 1)]
    return f


@wp.func
def filtered_by(textures: Textures, f: Filter, uv: wp.vec2):
    """Gives a texture at a place, under the footprint of a filter."""
    if f.taps == 0:
        return bilinear(textures.texels, f.fine, uv)
    at = uv + f.first
    total = wp.vec3(0.0, 0.0, 0.0)
    for _ in range(f.taps):
        total += (1.0 - f.share) * bilinear(textures.texels, f.fine, at)
        if f.share > 0.0:
            total += f.share * bilinear(textures.texels, f.coarse, at)
        at += f.step
    return total / float(f.taps)


@wp.func
def filtered(textures: Textures, place: wp.vec2i, uv: wp.vec2, across: wp.vec2, down: wp.vec2):
    """Gives a texture under a pixel; across, down: as of `filter_of`."""
    return filtered_by(textures, filter_of(textures, place, across, down), uv)
