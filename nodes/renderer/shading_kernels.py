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
from nodes.renderer.write_kernels import make_image, make_write

wp.set_module_options({"enable_backward": False})

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


@wp.struct
class Seen:
    """What the pixels show: z-buffer uint64 [E, H, W], vertices, and the instances' places [E, I] in the camera frame.

    hidden: of shadow_kernels, bits [E, H, W] of the lights that are not seen from a pixel; may have no elements.
    """

    packed: wp.array3d(dtype=wp.uint64)
    vertices: wp.array2d(dtype=wp.vec3)
    rotation: wp.array2d(dtype=wp.mat33)
    translation: wp.array2d(dtype=wp.vec3)
    hidden: wp.array3d(dtype=wp.uint32)


@wp.struct
class Kept:
    """What is remembered of still surfaces [E, H, W]: the triangle that it is of, MISS for none; a bit for each light
    that reaches it; its radiance without moving casters."""

    triangle: wp.array3d(dtype=int)
    lit: wp.array3d(dtype=wp.uint32)
    colour: wp.array3d(dtype=wp.vec3)


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
    hard: bool,
    soft: bool,
    trees: bool,
    joined: bool,
    cached: bool,
    half: bool,
    ambience: bool,
    masked: bool,
    tiled: bool,
) -> tuple[wp.Kernel, wp.Kernel]:
    """The shading kernels, of all pixels and of a list of them, with only what a scene has.

    cached: of a still surface under still lights, the radiance without moving casters is remembered with a bit for each
    light that then reaches it; while none of these is hidden by a moving caster, that radiance is the result. flicker:
    strengths change, so of these only the bits are used. ambience: with the sky's light, which nothing hides. hard: a
    light that is a point has shadows; soft: an area light has. joined: of `make_occlusion`. masked: shadow_kernels has
    been before. tiled: threads that run together have a tile of pixels (kernels.tile_pixel).
    """
    Image: Any = make_image(half)
    surface, write = make_surface(textures, smooth), make_write(half)
    lit, shadows = directional or point or spot or area, hard or soft
    area_light = make_area(soft, trees, gloss, cached, joined) if area else None
    delta = directional, point, spot
    unhidden, gather = make_lighting(delta, area_light, hard, soft, trees, joined, cached, gloss, masked)
    background, ambient, sky_gloss = make_sky(mapped)

    @wp.func
    def shade_pixel(
        view: View,
        env: int,
        y: int,
        x: int,
        band: int,
        seen: Seen,
        surfaces: Surfaces,
        lights: Lights,
        sky: Sky,
        casters: Casters,
        kept: Kept,
        image: Image,
    ):
        hit = seen.packed[env, y, x]
        t = triangle_of(hit)
        d = pixel_ray(view, x, y)
        colour = wp.vec3(0.0, 0.0, 0.0)
        if t == MISS:
            colour = background(sky, env, d)
        else:
            i = surfaces.instance[t]
            s = SurfacePoint()
            s.position = depth_of(hit) * d
            turn = seen.rotation[env, i]
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
                known = kept.triangle[env, y, x] == t
                if known:
                    bits = kept.lit[env, y, x]
                    if wp.static(not flicker):
                        reached = True
                        if wp.static(shadows):
                            reached = unhidden(lights, casters, env, bits, s)
            if reached:
                colour = kept.colour[env, y, x]
            else:
                albedo, facing = surface(
                    view, y, x, seen.vertices, surfaces, env, t, i, d, turn, seen.translation[env, i], side, s.normal
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
                    q = wp.transpose(turn) * (s.position - seen.translation[env, i])
                    s.key = frozen_key(q, wp.length(s.position) / view.fx, i)
                irradiance = wp.vec3(0.0, 0.0, 0.0)
                # The same without moving casters.
                unblocked = wp.vec3(0.0, 0.0, 0.0)
                still_shine = wp.vec3(0.0, 0.0, 0.0)
                mask = wp.uint32(0)
                if wp.static(masked):
                    mask = seen.hidden[env, y, x]
                if wp.static(lit):
                    irradiance, unblocked, shine, still_shine, bits = gather(
                        lights, casters, env, s, moved, last, known, bits, mask
                    )
                colour = glow + INVERSE_PI * wp.cw_mul(albedo, irradiance)
                if wp.static(gloss):
                    colour += shine
                if wp.static(cached):
                    if not known:
                        kept.triangle[env, y, x] = wp.where(casters.is_still[i] == 1, t, MISS)
                        kept.lit[env, y, x] = bits
                        if wp.static(not flicker):
                            unhid = glow + INVERSE_PI * wp.cw_mul(albedo, unblocked)
                            if wp.static(gloss):
                                unhid += still_shine
                            kept.colour[env, y, x] = unhid
        write(env, y, x, band, colour, image)

    # Kernels name their parameters one by one; these two share what they do, and so most of their names.
    @wp.kernel(module="unique", enable_backward=False)
    def shade(
        # in
        view: View,
        row0: int,
        band: int,
        span: int,
        seen: Seen,
        surfaces: Surfaces,
        lights: Lights,
        sky: Sky,
        casters: Casters,
        # in and out
        kept: Kept,
        # out
        image: Image,
    ):
        env, row, part = wp.tid()
        if wp.static(tiled):
            y, x = tile_pixel(view, row, part)
            if y < view.height and x < view.width:
                shade_pixel(view, env, y, x, band, seen, surfaces, lights, sky, casters, kept, image)
        else:
            y = row0 + row
            for x in range(part * span, wp.min(part * span + span, view.width)):
                shade_pixel(view, env, y, x, band, seen, surfaces, lights, sky, casters, kept, image)

    @wp.kernel(module="unique", enable_backward=False)
    def shade_list(
        # in
        view: View,
        workers: int,
        first: int,
        band: int,
        pixels: wp.array(dtype=int),
        count: wp.array(dtype=int),
        seen: Seen,
        surfaces: Surfaces,
        lights: Lights,
        sky: Sky,
        casters: Casters,
        # in and out
        kept: Kept,
        # out
        image: Image,
    ):
        j = wp.tid()
        while j < count[band]:
            at = pixels[first + j]
            env = at // (view.width * view.height)
            y = at // view.width % view.height
            x = at % view.width
            shade_pixel(view, env, y, x, band, seen, surfaces, lights, sky, casters, kept, image)
            if wp.static(masked):
                # For the next list.
                seen.hidden[env, y, x] = wp.uint32(0)
            j += workers

    return shade, shade_list
