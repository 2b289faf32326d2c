"""Light of the sky: uniform, or an equirectangular map (row 0 up, +z; column 0 at +x turning to +y); not occluded."""

from typing import Any

import warp as wp

from nodes.renderer.materials.ggx_kernels import masking, sample_density, sample_direction, specular_share, view_masking

wp.set_module_options({"enable_backward": False})

PI = wp.constant(wp.pi)


@wp.struct
class Sky:
    """Holds camera [E] to world. levels (first texel, width, height) of the map and its halvings, the last one of
    `diffuse`.

    texels: radiance of all levels. diffuse: irradiance / pi by normal. albedo: `ggx.directional_albedo`. points [N] in
    the unit square: the samples of the specular lobe, the same for every surface point.
    """

    uniform: wp.vec3
    camera: wp.array(dtype=wp.mat33)
    levels: wp.array(dtype=wp.vec3i)
    texels: wp.array(dtype=wp.vec3)
    diffuse: wp.array(dtype=wp.vec3)
    albedo: wp.array2d(dtype=wp.vec2)
    points: wp.array(dtype=wp.vec2)


@wp.func
def texel(texels: wp.array(dtype=wp.vec3), level: wp.vec3i, i: int, j: int):
    """Gives the texel of column i and row j; beyond a pole lies the other side of the map."""
    w = level[1]
    h = level[2]
    column = i
    row = j
    if row < 0:
        row = -1 - row
        column = column + w // 2
    if row >= h:
        row = 2 * h - 1 - row
        column = column + w // 2
    column = column % w
    if column < 0:
        column = column + w
    return texels[level[0] + row * w + column]


@wp.func
def equirect(texels: wp.array(dtype=wp.vec3), level: wp.vec3i, direction: wp.vec3):
    """Gives linear interpolation between the centres of the texels around a world direction."""
    azimuth = wp.atan2(direction[1], direction[0]) / (2.0 * PI)
    polar = wp.atan2(wp.sqrt(direction[0] * direction[0] + direction[1] * direction[1]), direction[2]) / PI
    x = azimuth * float(level[1]) - 0.5
    y = polar * float(level[2]) - 0.5
    i = int(wp.floor(x))
    j = int(wp.floor(y))
    fx = x - float(i)
    fy = y - float(j)
    upper = texel(texels, level, i, j) * (1.0 - fx) + texel(texels, level, i + 1, j) * fx
    lower = texel(texels, level, i, j + 1) * (1.0 - fx) + texel(texels, level, i + 1, j + 1) * fx
    return upper * (1.0 - fy) + lower * fy


@wp.func
def filtered(sky: Sky, direction: wp.vec3, lod: float):
    """Gives the map, linear between its halvings too."""
    top = sky.levels.shape[0] - 2
    place = wp.clamp(lod, 0.0, float(top))
    low = int(place)
    f = place - float(low)
    colour = equirect(sky.texels, sky.levels[low], direction)
    if f > 0.0:
        colour = colour * (1.0 - f) + f * equirect(sky.texels, sky.levels[wp.min(low + 1, top)], direction)
    return colour


@wp.func
def reflectances(sky: Sky, alpha: float, nv: float):
    """Looks up (a, b) of `ggx.directional_albedo`."""
    rows = sky.albedo.shape[0]
    columns = sky.albedo.shape[1]
    y = wp.sqrt(alpha) * float(rows - 1)
    x = wp.sqrt(wp.clamp(nv, 0.0, 1.0)) * float(columns - 1)
    i = wp.min(int(x), columns - 2)
    j = wp.min(int(y), rows - 2)
    fx = x - float(i)
    fy = y - float(j)
    upper = sky.albedo[j, i] * (1.0 - fx) + sky.albedo[j, i + 1] * fx
    lower = sky.albedo[j + 1, i] * (1.0 - fx) + sky.albedo[j + 1, i + 1] * fx
    return upper * (1.0 - fy) + lower * fy


def make_sky(mapped: bool) -> tuple[Any, Any, Any]:
    """Makes the functions `background`, `ambient` and `gloss` for a uniform sky or a map."""

    @wp.func
    def background(sky: Sky, env: int, ray: wp.vec3):
        """Gives the radiance from where a ray of the camera leads."""
        if wp.static(mapped):
            return equirect(sky.texels, sky.levels[0], sky.camera[env] * ray)
        return sky.uniform

    @wp.func
    def ambient(sky: Sky, env: int, n: wp.vec3):
        """Gives the irradiance / pi on a surface with normal n."""
        if wp.static(mapped):
            return equirect(sky.diffuse, sky.levels[sky.levels.shape[0] - 1], sky.camera[env] * n)
        return sky.uniform

    @wp.func
    def gloss(sky: Sky, env: int, n: wp.vec3, v: wp.vec3, alpha: float, f0: wp.vec3):
        """Estimates the radiance from the specular lobe; gives also `reflectances` at this view.

        The mean of the map over samples of the lobe, each as wide as its share (Krivanek and Colbert, EGSR 2008), times
        the lobe's exact albedo: right under a uniform sky, an approximation where map and Fresnel term vary together.
        """
        nv = wp.dot(n, v)
        r = reflectances(sky, alpha, nv)
        albedo = specular_share(r, f0)
        mean = sky.uniform
        if wp.static(mapped):
            mean = wp.vec3(0.0, 0.0, 0.0)
            total = wp.float32(0.0)
            count = float(sky.points.shape[0])
            whole = sky.levels[0]
            texels = float(whole[1]) * float(whole[2]) / (2.0 * PI * PI)
            for k in range(sky.points.shape[0]):
                l = sample_direction(alpha, n, v, sky.points[k])
                nl = wp.dot(n, l)
                if nl > 0.0:
                    density = sample_density(alpha, n, v, l)
                    held = wp.clamp(nv, 1.0e-4, 1.0)
                    weight = 4.0 * nl * held * masking(alpha, nl, held) / view_masking(alpha, held)
                    lod = 0.5 * wp.log2(texels / (count * density)) + 1.0
                    mean += weight * filtered(sky, sky.camera[env] * l, lod)
                    total += weight
            if total > 0.0:
                mean = mean / total
        return wp.cw_mul(albedo, mean), r

    return background, ambient, gloss
