"""Light that reaches seen surfaces over other surfaces, from the sky and from glowing surfaces: paths from the camera.

At every surface point a path takes one direction from the mixture of its lobes and aims once at a glowing triangle and
once at the sky's map; what two of these can find is weighted by the balance heuristic (Veach and Guibas, SIGGRAPH
1995). From the second point on it aims at one light too, chosen by what each would give if it were seen; at the first
one the light of lights is there already.
"""

from typing import Any

import warp as wp

from nodes.renderer.ggx_kernels import sample_direction
from nodes.renderer.kernels import MISS, View, depth_of, pixel_ray, triangle_of
from nodes.renderer.lights_kernels import FAR, Lights, SurfacePoint
from nodes.renderer.lights_shadow_kernels import Casters, make_occlusion
from nodes.renderer.lights_sky_kernels import Sky, make_sky
from nodes.renderer.path_aim_kernels import make_aims
from nodes.renderer.path_sampling_kernels import (
    GLOWING,
    PICTURE,
    Sources,
    around,
    cosine_direction,
    frozen_shift,
    point_of,
    sky_density,
)
from nodes.renderer.path_surface_kernels import Bodies, lifted, make_albedo, make_reflection, spread_of
from nodes.renderer.path_trace_kernels import make_first_hit
from nodes.renderer.shading_kernels import Seen, Surfaces, make_surface
from nodes.renderer.write_kernels import luminance, make_image, make_write

wp.set_module_options({"enable_backward": False})

LEAST_ALPHA = wp.constant(0.1)
"""Narrowest lobe from the second surface point on: a lamp found through a mirror by chance is one bright dot."""


def make_paths(
    textures: bool,
    smooth: bool,
    lit: bool,
    gloss: bool,
    mapped: bool,
    glowing: bool,
    trees: bool,
    joined: bool,
    dark: bool,
    half: bool,
) -> tuple[wp.Kernel, wp.Kernel]:
    """The kernels that add the light of paths to all pixels of an image, and to those of a list.

    joined: as of `make_occlusion`. dark: the sky is black, and no surface glows.
    """
    Image: Any = make_image(half)
    write = make_write(half)
    surface = make_surface(textures, smooth)
    background, _, _ = make_sky(mapped)
    occluded, _ = make_occlusion(trees, joined)
    first_hit = make_first_hit(trees, joined)
    lay, reflected = make_reflection(gloss)
    albedo_at = make_albedo(textures)
    of_lights, of_glow, of_sky = make_aims(gloss, mapped, trees, joined)

    @wp.func
    def sky_found(sources: Sources, sky: Sky, env: int, ray: wp.vec3, density: float):
        """The sky's radiance on a path that took this ray with this density, weighted against aiming at it."""
        shine = background(sky, env, ray)
        if wp.static(mapped):
            shine = (density / (density + sky_density(sources, sky.camera[env] * ray))) * shine
        return shine

    @wp.func
    def paths(
        view: View,
        env: int,
        y: int,
        x: int,
        bounces: int,
        samples: int,
        roulette: int,
        seen: Seen,
        surfaces: Surfaces,
        lights: Lights,
        sky: Sky,
        casters: Casters,
        bodies: Bodies,
        sources: Sources,
    ):
        """Radiance of a pixel from paths, the mean of `samples` of them."""
        rotation = seen.rotation
        translation = seen.translation
        total = wp.vec3(0.0, 0.0, 0.0)
        t = triangle_of(seen.packed[env, y, x])
        if t == MISS:
            return total
        d = pixel_ray(view, x, y)
        i0 = surfaces.instance[t]
        turn = rotation[env, i0]
        first = SurfacePoint()
        first.position = depth_of(seen.packed[env, y, x]) * d
        normal = turn * surfaces.normals[t]
        side = wp.where(wp.dot(normal, d) > 0.0, -1.0, 1.0)
        first.normal = side * normal
        albedo, facing = surface(
            view, y, x, seen.vertices, surfaces, env, t, i0, d, turn, translation[env, i0], side, first.normal
        )
        first.facing = facing
        first.view = -wp.normalize(d)
        first.alpha = surfaces.gloss[surfaces.material[i0]][0]
        metallic = surfaces.gloss[surfaces.material[i0]][1]
        diffuse0, f0, alpha, share0 = lay(first, sky, albedo, metallic, 0.0)
        first.f0 = f0
        first = lifted(casters, first, i0, side)
        q = wp.transpose(turn) * (first.position - translation[env, i0])
        shift = frozen_shift(q, casters.radius[i0], i0)
        last = casters.order.shape[0]
        for k in range(samples):
            s = first
            diffuse = diffuse0
            share = share0
            turned = turn
            through = wp.vec3(1.0, 1.0, 1.0)
            width = wp.float32(0.0)
            for bounce in range(bounces + 1):
                u = point_of(k, samples, bounce, i0, wp.vec2(shift[0], shift[1]))
                if wp.static(lit):
                    if bounce > 0:
                        other = point_of(k, samples, bounce + 64, i0, wp.vec2(shift[2], shift[3]))
                        total += wp.cw_mul(
                            through,
                            of_lights(
                                lights,
                                casters,
                                env,
                                s,
                                diffuse,
                                width,
                                other,
                                around(u[0] + shift[3]),
                            ),
                        )
                if wp.static(glowing):
                    aim = point_of(k, samples, bounce, i0, wp.vec2(shift[3], shift[2]))
                    total += wp.cw_mul(
                        through,
                        of_glow(sources, surfaces, bodies, casters, env, s, diffuse, share, aim),
                    )
                if wp.static(mapped):
                    aim = point_of(k, samples, bounce, i0, wp.vec2(shift[2], shift[3]))
                    total += wp.cw_mul(
                        through,
                        of_sky(sources, sky, casters, env, s, diffuse, share, aim),
                    )
                if wp.static(dark):
                    if bounce == bounces:
                        break
                ray = wp.vec3(0.0, 0.0, 0.0)
                # One number chooses the lobe and, from what is left of it, the direction.
                if u[0] < share:
                    ray = sample_direction(s.alpha, s.facing, s.view, wp.vec2(u[0] / share, u[1]))
                else:
                    ray = cosine_direction(s.facing, turned, wp.vec2((u[0] - share) / (1.0 - share), u[1]))
                value, density = reflected(s, diffuse, share, ray)
                if density == 0.0:
                    break
                through = wp.cw_mul(through, value / density)
                if wp.static(not glowing):
                    if bounce == bounces:
                        # Only whether the sky is there matters any more.
                        if not occluded(casters, env, 0, last, s.alone, s.lift, ray, FAR):
                            total += wp.cw_mul(through, sky_found(sources, sky, env, ray, density))
                        break
                hit = first_hit(casters, env, s.alone, s.lift, ray, FAR)
                i = hit.instance
                if i < 0:
                    total += wp.cw_mul(through, sky_found(sources, sky, env, ray, density))
                    break
                t = bodies.first[i] + hit.face
                turned = rotation[env, i]
                normal = turned * surfaces.normals[t]
                along = wp.dot(normal, ray)
                side = wp.where(along > 0.0, -1.0, 1.0)
                if along > 0.0 and bodies.two_sided[i] == 0:
                    break
                m = surfaces.material[i]
                if sources.glows[i] == PICTURE:
                    break
                if wp.static(glowing):
                    if sources.glows[i] == GLOWING:
                        away = hit.distance
                        chance = luminance(surfaces.emission[m]) * sources.glow_density
                        chance = chance * (away / wp.max(wp.abs(along), 1.0e-6) * away)
                        total += (density / (density + chance)) * wp.cw_mul(through, surfaces.emission[m])
                if bounce == bounces:
                    break
                if roulette == 1 and bounce > 0:
                    stay = wp.min(wp.max(through), 1.0)
                    state = wp.rand_init(i0 * 7919 + bounce + 128, k)
                    if around(wp.randf(state) + shift[1]) >= stay:
                        break
                    through = through / stay
                width += hit.distance * spread_of(density, samples)
                start = s.lift
                s = SurfacePoint()
                s.position = start + hit.distance * ray
                s.normal = side * normal
                s.facing = s.normal
                s.view = -ray
                if wp.static(smooth):
                    j = 3 * t
                    n = hit.w0 * surfaces.smooth[j] + hit.w1 * surfaces.smooth[j + 1]
                    n += (1.0 - hit.w0 - hit.w1) * surfaces.smooth[j + 2]
                    if wp.dot(n, n) > 0.0:
                        s.facing = side * wp.normalize(turned * n)
                s.alpha = surfaces.gloss[m][0]
                albedo = albedo_at(surfaces, bodies, i, t, hit.w0, hit.w1, width)
                diffuse, f0, alpha, share = lay(s, sky, albedo, surfaces.gloss[m][1], LEAST_ALPHA)
                s.f0 = f0
                s.alpha = alpha
                s = lifted(casters, s, i, side)
        return total / float(samples)

    # Kernels name their parameters one by one; these two share what they do, and so most of their names.
    @wp.kernel(module="unique", enable_backward=False)
    def add_paths(
        # in
        view: View,
        row0: int,
        band: int,
        span: int,
        bounces: int,
        samples: int,
        roulette: int,
        seen: Seen,
        surfaces: Surfaces,
        lights: Lights,
        sky: Sky,
        casters: Casters,
        bodies: Bodies,
        sources: Sources,
        direct: wp.array3d(dtype=wp.vec3),
        # out
        image: Image,
    ):
        env, row, part = wp.tid()
        y = row0 + row
        for x in range(part * span, wp.min(part * span + span, view.width)):
            colour = direct[env, y, x] + paths(
                view, env, y, x, bounces, samples, roulette, seen, surfaces, lights, sky, casters, bodies, sources
            )
            write(env, y, x, band, colour, image)

    @wp.kernel(module="unique", enable_backward=False)
    def add_paths_list(
        # in
        view: View,
        workers: int,
        first: int,
        band: int,
        pixels: wp.array(dtype=int),
        count: wp.array(dtype=int),
        bounces: int,
        samples: int,
        roulette: int,
        seen: Seen,
        surfaces: Surfaces,
        lights: Lights,
        sky: Sky,
        casters: Casters,
        bodies: Bodies,
        sources: Sources,
        direct: wp.array3d(dtype=wp.vec3),
        # out
        image: Image,
    ):
        j = wp.tid()
        while j < count[band]:
            at = pixels[first + j]
            env = at // (view.width * view.height)
            y = at // view.width % view.height
            x = at % view.width
            colour = direct[env, y, x] + paths(
                view, env, y, x, bounces, samples, roulette, seen, surfaces, lights, sky, casters, bodies, sources
            )
            write(env, y, x, band, colour, image)
            j += workers

    return add_paths, add_paths_list
