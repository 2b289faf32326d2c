"""Radiance of the pixels that a z-buffer has found: what surfaces emit, and reflect of the lights and the sky."""

from functools import cache
from typing import Any

import warp as wp

from nodes.renderer.kernels import (
    MISS,
    View,
    corner,
    depth_of,
    edge_normal,
    pixel_ray,
    ray_steps,
    tile_pixel,
    triangle_of,
)
from nodes.renderer.lights_area_kernels import frozen_key, make_area
from nodes.renderer.lights_kernels import Lights, SurfacePoint, make_lighting
from nodes.renderer.lights_shadow_kernels import Casters, shadow_start
from nodes.renderer.lights_sky_kernels import DIELECTRIC, Sky, make_sky, reflectances
from nodes.renderer.texture_kernels import Textures, filtered

wp.set_module_options({"enable_backward": False})

LARGEST_HALF = wp.constant(65504.0)
"""The largest float16."""

INVERSE_PI = wp.constant(1.0 / wp.pi)


@wp.struct
class Surfaces:
    """What the triangles look like; material is per instance; gloss (alpha, metallic) is the material's."""

    instance: wp.array(dtype=int)
    triangles: wp.array(dtype=wp.vec3i)
    normals: wp.array(dtype=wp.vec3)
    uv: wp.array(dtype=wp.vec2)
    smooth: wp.array(dtype=wp.vec3)
    material: wp.array(dtype=int)
    albedo: wp.array(dtype=wp.vec3)
    emission: wp.array(dtype=wp.vec3)
    gloss: wp.array(dtype=wp.vec2)
    textures: Textures


@wp.func
def finite(value: float, largest: float):
    """An infinite value becomes the largest one; what is not a number becomes dark."""
    if wp.isfinite(value):
        return value
    return wp.where(value > 0.0, largest, 0.0)


@cache
def make_surface(textures: bool, smooth: bool) -> Any:
    """The function of a seen point's albedo and shading normal."""

    @wp.func
    def surface(
        view: View,
        y: int,
        x: int,
        vertices: wp.array2d(dtype=wp.vec3),
        surfaces: Surfaces,
        env: int,
        t: int,
        i: int,
        d: wp.vec3,
        turn: wp.mat33,
        centre: wp.vec3,
        side: float,
        normal: wp.vec3,
    ):
        """Albedo and shading normal where ray d meets triangle t."""
        albedo = surfaces.albedo[surfaces.material[i]]
        facing = normal
        if wp.static(textures or smooth):
            k = surfaces.triangles[t]
            a = corner(view, vertices, turn, centre, env, k[0])
            b = corner(view, vertices, turn, centre, env, k[1])
            c = corner(view, vertices, turn, centre, env, k[2])
            e0 = edge_normal(b, c)
            e1 = edge_normal(c, a)
            e2 = edge_normal(a, b)
            w = wp.vec3(wp.dot(e0, d), wp.dot(e1, d), wp.dot(e2, d))
            total = w[0] + w[1] + w[2]
            w = w / total
            j = 3 * t
            if wp.static(textures):
                place = surfaces.textures.place[i]
                if place[1] > 0:
                    uv0 = surfaces.uv[j]
                    uv1 = surfaces.uv[j + 1]
                    uv2 = surfaces.uv[j + 2]
                    uv = w[0] * uv0 + w[1] * uv1 + w[2] * uv2
                    # The weights are linear in d before they are divided by their sum.
                    right, below = ray_steps(view, x, y)
                    right = right / total
                    below = below / total
                    across = wp.dot(e0, right) * (uv0 - uv) + wp.dot(e1, right) * (uv1 - uv)
                    across += wp.dot(e2, right) * (uv2 - uv)
                    down = wp.dot(e0, below) * (uv0 - uv) + wp.dot(e1, below) * (uv1 - uv)
                    down += wp.dot(e2, below) * (uv2 - uv)
                    albedo = wp.cw_mul(albedo, filtered(surfaces.textures, place, uv, across, down))
            if wp.static(smooth):
                n = w[0] * surfaces.smooth[j] + w[1] * surfaces.smooth[j + 1] + w[2] * surfaces.smooth[j + 2]
                if wp.dot(n, n) > 0.0:
                    facing = side * wp.normalize(turn * n)
        return albedo, facing

    return surface


@cache
def make_write(half: bool) -> Any:
    """The function that writes a pixel; half: as float16, clipped and counted at its largest."""
    pixel = wp.vec3h if half else wp.vec3f
    largest = 65504.0 if half else 3.0e38

    @wp.func
    def write(
        env: int,
        y: int,
        x: int,
        band: int,
        value: wp.vec3,
        radiance: wp.array3d(dtype=pixel),
        not_finite: wp.array(dtype=int),
        clipped: wp.array(dtype=int),
    ):
        colour = value
        if not (wp.isfinite(colour[0]) and wp.isfinite(colour[1]) and wp.isfinite(colour[2])):
            wp.atomic_add(not_finite, band, 1)
            most = wp.static(largest)
            colour = wp.vec3(finite(colour[0], most), finite(colour[1], most), finite(colour[2], most))
        if wp.static(half):
            if wp.max(colour) > LARGEST_HALF:
                wp.atomic_add(clipped, band, 1)
                colour = wp.min(colour, wp.vec3(LARGEST_HALF, LARGEST_HALF, LARGEST_HALF))
            radiance[env, y, x] = wp.vec3h(wp.float16(colour[0]), wp.float16(colour[1]), wp.float16(colour[2]))
        else:
            radiance[env, y, x] = colour

    return write


def make_shade(
    textures: bool,
    smooth: bool,
    directional: bool,
    point: bool,
    spot: bool,
    area: bool,
    gloss: bool,
    mapped: bool,
    flicker: bool,
    shadows: bool,
    trees: bool,
    cached: bool,
    half: bool,
    ambience: bool,
    masked: bool,
    tiled: bool,
) -> tuple[wp.Kernel, wp.Kernel]:
    """The shading kernels, of all pixels and of a list of them, with only what a scene has.

    cached: of a still surface under still lights, the radiance without moving casters is remembered with a bit for each
    light that then reaches it; while none of these is hidden by a moving caster, that radiance is the result. flicker:
    strengths change, so of these only the bits are used. ambience: with the sky's light, which nothing hides. masked:
    shadow_kernels has been before. tiled: threads that run together have a tile of pixels (kernels.tile_pixel).
    """
    pixel = wp.vec3h if half else wp.vec3f
    surface, write = make_surface(textures, smooth), make_write(half)
    lit = directional or point or spot or area
    area_light = make_area(shadows, trees, gloss) if area else None
    unhidden, gather = make_lighting(directional, point, spot, area_light, shadows, trees, cached, gloss, masked)
    background, ambient, sky_gloss = make_sky(mapped)

    @wp.func
    def shade_pixel(
        view: View,
        env: int,
        y: int,
        x: int,
        band: int,
        packed: wp.array3d(dtype=wp.uint64),
        vertices: wp.array2d(dtype=wp.vec3),
        rotation: wp.array2d(dtype=wp.mat33),
        translation: wp.array2d(dtype=wp.vec3),
        surfaces: Surfaces,
        lights: Lights,
        sky: Sky,
        casters: Casters,
        cached_triangle: wp.array3d(dtype=int),
        cached_lit: wp.array3d(dtype=wp.uint32),
        cached_colour: wp.array3d(dtype=wp.vec3),
        hidden: wp.array3d(dtype=wp.uint32),
        radiance: wp.array3d(dtype=pixel),
        not_finite: wp.array(dtype=int),
        clipped: wp.array(dtype=int),
    ):
        hit = packed[env, y, x]
        t = triangle_of(hit)
        d = pixel_ray(view, x, y)
        colour = wp.vec3(0.0, 0.0, 0.0)
        if t == MISS:
            colour = background(sky, env, d)
        else:
            i = surfaces.instance[t]
            s = SurfacePoint()
            s.position = depth_of(hit) * d
            turn = rotation[env, i]
            normal = turn * surfaces.normals[t]
            side = wp.where(wp.dot(normal, d) > 0.0, -1.0, 1.0)
            s.normal = side * normal
            s.alpha = -1.0
            # Casters from this one on may have moved.
            moved = wp.int32(0)
            last = wp.int32(0)
            known = wp.bool(False)
            reached = wp.bool(False)
            bits = wp.uint32(0)
            if wp.static(shadows):
                lift, alone = shadow_start(casters, i, s.position, s.normal, side > 0.0)
                s.lift = lift
                s.alone = alone
                last = casters.order.shape[0]
            if wp.static(cached):
                moved = casters.still
                known = cached_triangle[env, y, x] == t
                if known:
                    bits = cached_lit[env, y, x]
                    if wp.static(not flicker):
                        reached = True
                        if wp.static(shadows):
                            reached = unhidden(lights, casters, rotation, translation, env, bits, s)
            if reached:
                colour = cached_colour[env, y, x]
            else:
                albedo, facing = surface(
                    view, y, x, vertices, surfaces, env, t, i, d, turn, translation[env, i], side, s.normal
                )
                s.facing = facing
                m = surfaces.material[i]
                shine = wp.vec3(0.0, 0.0, 0.0)
                if wp.static(gloss):
                    s.alpha = surfaces.gloss[m][0]
                glow = wp.vec3(0.0, 0.0, 0.0)
                if wp.static(ambience):
                    glow = wp.cw_mul(albedo, ambient(sky, env, facing))
                if wp.static(gloss):
                    if s.alpha >= 0.0:
                        metallic = surfaces.gloss[m][1]
                        s.view = -wp.normalize(d)
                        s.f0 = DIELECTRIC * (1.0 - metallic) * wp.vec3(1.0, 1.0, 1.0) + metallic * albedo
                        left = wp.float32(0.0)
                        if wp.static(ambience):
                            mirrored, left = sky_gloss(sky, env, facing, s.view, s.alpha, s.f0)
                            left *= 1.0 - metallic
                            glow = mirrored + left * glow
                        else:
                            r = reflectances(sky, s.alpha, wp.dot(facing, s.view))
                            left = (1.0 - DIELECTRIC * r[0] - r[1]) * (1.0 - metallic)
                        albedo = left * albedo
                glow = surfaces.emission[m] + glow
                if wp.static(area):
                    q = wp.transpose(turn) * (s.position - translation[env, i])
                    s.key = frozen_key(q, wp.length(s.position) / view.fx, i)
                irradiance = wp.vec3(0.0, 0.0, 0.0)
                # The same without moving casters.
                unblocked = wp.vec3(0.0, 0.0, 0.0)
                still_shine = wp.vec3(0.0, 0.0, 0.0)
                mask = wp.uint32(0)
                if wp.static(masked):
                    mask = hidden[env, y, x]
                if wp.static(lit):
                    irradiance, unblocked, shine, still_shine, bits = gather(
                        lights, casters, rotation, translation, env, s, moved, last, known, bits, mask
                    )
                colour = glow + INVERSE_PI * wp.cw_mul(albedo, irradiance)
                if wp.static(gloss):
                    colour += shine
                if wp.static(cached):
                    if not known:
                        cached_triangle[env, y, x] = wp.where(casters.is_still[i] == 1, t, MISS)
                        cached_lit[env, y, x] = bits
                        if wp.static(not flicker):
                            unhid = glow + INVERSE_PI * wp.cw_mul(albedo, unblocked)
                            if wp.static(gloss):
                                unhid += still_shine
                            cached_colour[env, y, x] = unhid
        write(env, y, x, band, colour, radiance, not_finite, clipped)

    @wp.kernel(module="unique", enable_backward=False)
    def shade(
        # in
        view: View,
        row0: int,
        band: int,
        span: int,
        packed: wp.array3d(dtype=wp.uint64),
        vertices: wp.array2d(dtype=wp.vec3),
        rotation: wp.array2d(dtype=wp.mat33),
        translation: wp.array2d(dtype=wp.vec3),
        surfaces: Surfaces,
        lights: Lights,
        sky: Sky,
        casters: Casters,
        hidden: wp.array3d(dtype=wp.uint32),
        # in and out
        cached_triangle: wp.array3d(dtype=int),
        cached_lit: wp.array3d(dtype=wp.uint32),
        cached_colour: wp.array3d(dtype=wp.vec3),
        # out
        radiance: wp.array3d(dtype=pixel),
        not_finite: wp.array(dtype=int),
        clipped: wp.array(dtype=int),
    ):
        env, row, part = wp.tid()
        if wp.static(tiled):
            y, x = tile_pixel(view, row, part)
            if y < view.height and x < view.width:
                shade_pixel(
                    view, env, y, x, band, packed, vertices, rotation, translation, surfaces, lights, sky, casters,
                    cached_triangle, cached_lit, cached_colour, hidden, radiance, not_finite, clipped,
                )  # fmt: skip
        else:
            y = row0 + row
            for x in range(part * span, wp.min(part * span + span, view.width)):
                shade_pixel(
                    view, env, y, x, band, packed, vertices, rotation, translation, surfaces, lights, sky, casters,
                    cached_triangle, cached_lit, cached_colour, hidden, radiance, not_finite, clipped,
                )  # fmt: skip

    @wp.kernel(module="unique", enable_backward=False)
    def shade_list(
        # in
        view: View,
        workers: int,
        first: int,
        band: int,
        pixels: wp.array(dtype=int),
        count: wp.array(dtype=int),
        packed: wp.array3d(dtype=wp.uint64),
        vertices: wp.array2d(dtype=wp.vec3),
        rotation: wp.array2d(dtype=wp.mat33),
        translation: wp.array2d(dtype=wp.vec3),
        surfaces: Surfaces,
        lights: Lights,
        sky: Sky,
        casters: Casters,
        hidden: wp.array3d(dtype=wp.uint32),
        # in and out
        cached_triangle: wp.array3d(dtype=int),
        cached_lit: wp.array3d(dtype=wp.uint32),
        cached_colour: wp.array3d(dtype=wp.vec3),
        # out
        radiance: wp.array3d(dtype=pixel),
        not_finite: wp.array(dtype=int),
        clipped: wp.array(dtype=int),
    ):
        j = wp.tid()
        while j < count[band]:
            at = pixels[first + j]
            shade_pixel(
                view, at // (view.width * view.height), at // view.width % view.height, at % view.width, band,
                packed, vertices, rotation, translation, surfaces, lights, sky, casters,
                cached_triangle, cached_lit, cached_colour, hidden, radiance, not_finite, clipped,
            )  # fmt: skip
            j += workers

    return shade, shade_list
