"""Computes the light of the sky: uniform, or an equirectangular map (row 0 up, +z; column 0 at +x turning to +y); not
occluded."""

from functools import cache
from typing import Any

import warp as wp

from nodes.renderer.lights.lobe_kernels import Means, specular_means_by_runs
from nodes.renderer.materials.ggx_kernels import (
    LEAST_COSINE,
    PI,
    fresnel_weight,
    lobe_axes,
    masking,
    sample_cap,
    specular_share,
    stretched_view,
    view_masking,
)

wp.set_module_options({"enable_backward": False})


@wp.struct
class Sky:
    """Holds camera [E] to world. levels (first texel, width, height) of the map and its halvings, the last one of
    `diffuse`.

    texels: radiance of all levels, each as `sky.surrounded` has it, and `lobe_kernels.BESIDE` more. diffuse: irradiance
    / pi by normal, as surrounded. albedo: `ggx.directional_albedo`. points [3, N]: the samples of the specular lobe,
    cosines and sines of an angle and heights in (0, 1], the same for every surface point.
    """

    uniform: wp.vec3
    camera: wp.array(dtype=wp.mat33)
    levels: wp.array(dtype=wp.vec3i)
    texels: wp.array(dtype=wp.vec3)
    diffuse: wp.array(dtype=wp.vec3)
    albedo: wp.array2d(dtype=wp.vec2)
    points: wp.array2d(dtype=wp.float32)


@wp.func
def texel(texels: wp.array(dtype=wp.vec3), level: wp.vec3i, i: int, j: int):
    """Reads the texel of column i, from -w // 2 - 1 to (w + 1) // 2, and row j, from -1 to h: see sky.surrounded."""
    return texels[level[0] + (j + 1) * (level[1] + 2) + i + (level[1] >> 1) + 1]


@wp.func
def at_angles(texels: wp.array(dtype=wp.vec3), level: wp.vec3i, angles: wp.vec2):
    """Gives linear interpolation between the centres of the texels around a place on the map.

    angles: azimuth / (2 pi) in [-0.5, 0.5] and polar angle / pi in [0, 1].
    """
    x = angles[0] * float(level[1]) - 0.5
    y = angles[1] * float(level[2]) - 0.5
    i = int(wp.floor(x))
    j = int(wp.floor(y))
    fx = x - float(i)
    fy = y - float(j)
    upper = texel(texels, level, i, j) * (1.0 - fx) + texel(texels, level, i + 1, j) * fx
    lower = texel(texels, level, i, j + 1) * (1.0 - fx) + texel(texels, level, i + 1, j + 1) * fx
    return upper * (1.0 - fy) + lower * fy


@wp.func
def equirect(texels: wp.array(dtype=wp.vec3), level: wp.vec3i, direction: wp.vec3):
    """Gives linear interpolation between the centres of the texels around a world direction of any length."""
    azimuth = wp.atan2(direction[1], direction[0]) / (2.0 * PI)
    polar = wp.atan2(wp.sqrt(direction[0] * direction[0] + direction[1] * direction[1]), direction[2]) / PI
    return at_angles(texels, level, wp.vec2(azimuth, polar))


@wp.func
def arctangent(y: float, x: float):
    """Gives atan2(y, x) for y >= 0 to 3e-7 rad, without a call of the C library (Abramowitz and Stegun, 4.4.49)."""
    across = wp.abs(x)
    t = wp.min(y, across) / wp.max(wp.max(y, across), 1.0e-30)
    s = t * t
    p = -0.0161657367 + s * 0.0028662257
    p = -0.0752896400 + s * (0.0429096138 + s * p)
    p = -0.1420889944 + s * (0.1065626393 + s * p)
    angle = t * (1.0 + s * (-0.3333314528 + s * (0.1999355085 + s * p)))
    if y > across:
        angle = 0.5 * PI - angle
    return wp.where(x < 0.0, PI - angle, angle)


@wp.func
def angles_of(direction: wp.vec3):
    """Gives the place on a map, as of `at_angles`, of a world direction, by `arctangent`."""
    across = wp.sqrt(direction[0] * direction[0] + direction[1] * direction[1])
    azimuth = arctangent(wp.abs(direction[1]), direction[0]) * (0.5 / PI)
    return wp.vec2(wp.where(direction[1] < 0.0, -azimuth, azimuth), arctangent(across, direction[2]) / PI)


@wp.func
def filtered(sky: Sky, angles: wp.vec2, lod: float):
    """Gives the map around a place as of `at_angles`, linear between its halvings too."""
    top = sky.levels.shape[0] - 2
    place = wp.clamp(lod, 0.0, float(top))
    low = int(place)
    f = place - float(low)
    colour = at_angles(sky.texels, sky.levels[low], angles)
    if f > 0.0:
        colour = colour * (1.0 - f) + f * at_angles(sky.texels, sky.levels[wp.min(low + 1, top)], angles)
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


@wp.func
def specular_means_by_sample(
    sky: Sky, to_world: wp.mat33, view: wp.vec2, alpha: float, held: float, stretched: wp.vec3, widest: float
) -> Means:
    """Gives the two means of `make_specular_means`, one sample after another: specular_means.h does the same by runs.

    view: towards the viewer, by t and n. held: n.v, held. widest: halvings of the map that suit a sample whose share of
    the lobe is 1.
    """
    base = wp.vec3(0.0, 0.0, 0.0)
    rim = wp.vec3(0.0, 0.0, 0.0)
    base_weight = wp.float32(0.0)
    rim_weight = wp.float32(0.0)
    for k in range(sky.points.shape[1]):
        cap = sample_cap(stretched, wp.vec2(sky.points[0, k], sky.points[1, k]), sky.points[2, k])
        h = wp.vec3(alpha * cap[0], alpha * cap[1], wp.max(cap[2], 0.0))
        hh = wp.dot(h, h)
        vh = view[0] * h[0] + view[1] * h[2]
        twice = 2.0 * vh / hh
        l = wp.vec3(twice * h[0] - view[0], twice * h[1], twice * h[2] - view[1])
        if l[2] > 0.0:
            weight = l[2] * masking(alpha, l[2], held)
            glancing = weight * fresnel_weight(vh / wp.sqrt(hh))
            colour = filtered(sky, angles_of(to_world * l), widest - wp.log2(hh / wp.dot(cap, cap)))
            base += (weight - glancing) * colour
            rim += glancing * colour
            base_weight += weight - glancing
            rim_weight += glancing
    if base_weight > 0.0:
        base = base / base_weight
    if rim_weight > 0.0:
        rim = rim / rim_weight
    return wp.matrix_from_rows(base, rim)


@cache
def make_specular_means(by_runs: bool) -> Any:
    """Makes the function `specular_means`. by_runs: for a CPU, in C++."""

    @wp.func
    def specular_means(sky: Sky, env: int, n: wp.vec3, v: wp.vec3, alpha: float) -> Means:
        """Estimates what the specular lobe gathers of the map: two means of its radiance, one as Schlick's weight has
        it where the surface reflects by f0, and one where it reflects whatever f0 is.

        Samples of the visible normals, each as wide as its share of the lobe (Krivanek and Colbert, EGSR 2008), in the
        surface's own frame: t, b and n.
        """
        t, b = lobe_axes(n, v)
        to_world = sky.camera[env] * wp.matrix_from_cols(t, b, n)
        # v without the component along b, which it does not have.
        view = wp.vec2(wp.dot(v, t), wp.dot(v, n))
        held = wp.clamp(view[1], LEAST_COSINE, 1.0)
        stretched = stretched_view(alpha, held)
        whole = sky.levels[0]
        texels = float(whole[1]) * float(whole[2]) / (2.0 * PI * PI)
        # The density of l is D G1 / (4 n.v), with D = (h.h / (alpha c.c))^2 / pi of a cap c and h = (alpha c_t,
        # alpha c_b, c_n).
        width = texels * 4.0 * PI * held / (float(sky.points.shape[1]) * view_masking(alpha, held))
        widest = 0.5 * wp.log2(width) + wp.log2(alpha)
        if wp.static(by_runs):
            return specular_means_by_runs(
                sky.points, sky.levels, sky.texels, to_world, view, alpha, held, stretched, widest
            )
        return specular_means_by_sample(sky, to_world, view, alpha, held, stretched, widest)

    return specular_means


def make_sky(sky_map: bool, by_runs: bool = False) -> tuple[Any, Any, Any]:
    """Makes the functions `background`, `ambient` and `gloss` for a uniform sky or a map. by_runs: see
    `make_specular_means`."""
    specular_means = make_specular_means(by_runs)

    @wp.func
    def background(sky: Sky, env: int, ray: wp.vec3):
        """Gives the radiance from where a ray of the camera leads."""
        if wp.static(sky_map):
            return equirect(sky.texels, sky.levels[0], sky.camera[env] * ray)
        return sky.uniform

    @wp.func
    def ambient(sky: Sky, env: int, n: wp.vec3):
        """Gives the irradiance / pi on a surface with normal n."""
        if wp.static(sky_map):
            return equirect(sky.diffuse, sky.levels[sky.levels.shape[0] - 1], sky.camera[env] * n)
        return sky.uniform

    @wp.func
    def gloss(sky: Sky, env: int, n: wp.vec3, v: wp.vec3, alpha: float, f0: wp.vec3):
        """Estimates the radiance from the specular lobe; gives also `reflectances` at this view.

        `specular_means` by the exact shares (a, b) of a uniform sky, so that the noise of samples is that of the map.
        """
        r = reflectances(sky, alpha, wp.dot(n, v))
        if wp.static(sky_map):
            found = specular_means(sky, env, n, v, alpha)
            return r[0] * wp.cw_mul(f0, found[0]) + r[1] * found[1], r
        return wp.cw_mul(specular_share(r, f0), sky.uniform), r

    return background, ambient, gloss
