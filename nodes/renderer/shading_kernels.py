"""Radiance of the pixels that a z-buffer has found: diffuse reflection of lights and sky, ray-traced hard shadows."""

import warp as wp

from nodes.renderer.kernels import MISS, View, depth_of, edge_normal, pixel_ray, triangle_of

wp.set_module_options({"enable_backward": False})

DIRECTIONAL = wp.constant(0)
POINT = wp.constant(1)

CONVEX = wp.constant(1)
PLANAR = wp.constant(2)

OFFSET = wp.constant(4.0e-6)
"""Start of a shadow ray above its surface, of the distance plus the instance's size: tens of float32 roundings."""

FAR = wp.constant(1.0e30)
"""Length [m] of the shadow ray of a directional light."""

LARGEST_HALF = wp.constant(65504.0)
"""The largest float16."""

PI = wp.constant(wp.pi)


@wp.struct
class Surfaces:
    """What the triangles look like; material and texture are per instance.

    Textures lie one after another in texels, row by row from v = 1 downwards.
    """

    instance: wp.array(dtype=int)
    triangles: wp.array(dtype=wp.vec3i)
    normals: wp.array(dtype=wp.vec3)
    uv: wp.array(dtype=wp.vec2)
    smooth: wp.array(dtype=wp.vec3)
    material: wp.array(dtype=int)
    albedo: wp.array(dtype=wp.vec3)
    emission: wp.array(dtype=wp.vec3)
    texture: wp.array(dtype=wp.vec3i)
    """(first texel, width, height) of an instance's texture; width 0 = none."""
    texels: wp.array(dtype=wp.vec3)
    environment: wp.vec3


@wp.struct
class Lights:
    """kind, colour, shadow [L]; vector [E, L] in the camera frame: towards a directional light, or the position."""

    kind: wp.array(dtype=int)
    colour: wp.array(dtype=wp.vec3)
    shadow: wp.array(dtype=int)
    vector: wp.array2d(dtype=wp.vec3)


@wp.struct
class Casters:
    """Instances as occluders. mesh [I] ids; radius and shell [I]; order [I]: still ones first, `still` of them."""

    mesh: wp.array(dtype=wp.uint64)
    radius: wp.array(dtype=float)
    shell: wp.array(dtype=int)
    order: wp.array(dtype=int)
    still: int
    is_still: wp.array(dtype=int)


@wp.func
def wrap(i: int, n: int):
    r = i % n
    return wp.where(r < 0, r + n, r)


@wp.func
def finite(value: float, largest: float):
    """An infinite value becomes the largest one; what is not a number becomes dark."""
    if wp.isfinite(value):
        return value
    return wp.where(value > 0.0, largest, 0.0)


@wp.func
def bilinear(texels: wp.array(dtype=wp.vec3), texture: wp.vec3i, uv: wp.vec2):
    """Linear interpolation between texel centres ((i + 0.5) / width, 1 - (j + 0.5) / height), repeating."""
    w = texture[1]
    h = texture[2]
    # The whole number is taken off first, so that the fraction of a far repetition keeps its digits.
    x = (uv[0] - wp.floor(uv[0])) * float(w) - 0.5
    y = (1.0 - (uv[1] - wp.floor(uv[1]))) * float(h) - 0.5
    i = int(wp.floor(x))
    j = int(wp.floor(y))
    fx = x - float(i)
    fy = y - float(j)
    left = wrap(i, w)
    right = wrap(i + 1, w)
    above = texture[0] + wrap(j, h) * w
    below = texture[0] + wrap(j + 1, h) * w
    upper = texels[above + left] * (1.0 - fx) + texels[above + right] * fx
    lower = texels[below + left] * (1.0 - fx) + texels[below + right] * fx
    return upper * (1.0 - fy) + lower * fy


@wp.func
def occluded(
    casters: Casters,
    rotation: wp.array2d(dtype=wp.mat33),
    translation: wp.array2d(dtype=wp.vec3),
    env: int,
    first: int,
    last: int,
    skip: int,
    origin: wp.vec3,
    direction: wp.vec3,
    length: float,
):
    """Whether casters order[first..last) but `skip` are in the way; each is tried only if its bounding sphere is."""
    for k in range(first, last):
        i = casters.order[k]
        if i != skip:
            centre = translation[env, i] - origin
            along = wp.dot(centre, direction)
            away = centre - along * direction
            # The margin is the rounding of positions at this distance.
            radius = casters.radius[i] + 1.0e-6 * wp.abs(along)
            if wp.dot(away, away) <= radius * radius and along >= -radius and along - radius <= length:
                inverse = wp.transpose(rotation[env, i])
                if wp.mesh_query_ray_anyhit(casters.mesh[i], -(inverse * centre), inverse * direction, length):
                    return True
    return False


def make_shade(
    textures: bool, smooth: bool, directional: bool, point: bool, shadows: bool, cache: bool, half: bool
) -> wp.Kernel:
    """The shading kernel with only what a scene has.

    cache: of a still surface under still lights, the radiance without moving casters is remembered with a bit for each
    light that then reaches it; while none of these is hidden by a moving caster, that radiance is the result.
    """
    pixel = wp.vec3h if half else wp.vec3f
    largest = 65504.0 if half else 3.0e38
    lit = directional or point
    both = directional and point

    @wp.func
    def towards(lights: Lights, env: int, l: int, p: wp.vec3):
        """Unit vector to a light, its distance, and 1 / distance^2 (1 for a directional light)."""
        vector = lights.vector[env, l]
        if wp.static(not point):
            return vector, FAR, 1.0
        if wp.static(both):
            if lights.kind[l] == DIRECTIONAL:
                return vector, FAR, 1.0
        vector = vector - p
        length = wp.length(vector)
        # Divided twice, for the square of a far light's distance would overflow.
        return vector / length, length, 1.0 / length / length

    @wp.func
    def unhidden(
        lights: Lights,
        casters: Casters,
        rotation: wp.array2d(dtype=wp.mat33),
        translation: wp.array2d(dtype=wp.vec3),
        env: int,
        bits: wp.uint32,
        skip: int,
        p: wp.vec3,
        lift: wp.vec3,
    ):
        """Whether no moving caster hides any of the lights in `bits`."""
        last = casters.order.shape[0]
        for l in range(lights.kind.shape[0]):
            if ((bits >> wp.uint32(l)) & wp.uint32(1)) != wp.uint32(0):
                ray, length, _ = towards(lights, env, l, p)
                if occluded(casters, rotation, translation, env, casters.still, last, skip, lift, ray, length):
                    return False
        return True

    @wp.func
    def surface(
        vertices: wp.array2d(dtype=wp.vec3),
        surfaces: Surfaces,
        env: int,
        t: int,
        i: int,
        d: wp.vec3,
        turn: wp.mat33,
        side: float,
        normal: wp.vec3,
    ):
        """Albedo and shading normal where ray d meets triangle t."""
        albedo = surfaces.albedo[surfaces.material[i]]
        facing = normal
        if wp.static(textures or smooth):
            k = surfaces.triangles[t]
            a = vertices[env, k[0]]
            b = vertices[env, k[1]]
            c = vertices[env, k[2]]
            w0 = wp.dot(edge_normal(b, c), d)
            w1 = wp.dot(edge_normal(c, a), d)
            w2 = wp.dot(edge_normal(a, b), d)
            w = wp.vec3(w0, w1, w2) / (w0 + w1 + w2)
            j = 3 * t
            if wp.static(textures):
                texture = surfaces.texture[i]
                if texture[1] > 0:
                    uv = w[0] * surfaces.uv[j] + w[1] * surfaces.uv[j + 1] + w[2] * surfaces.uv[j + 2]
                    albedo = wp.cw_mul(albedo, bilinear(surfaces.texels, texture, uv))
            if wp.static(smooth):
                n = w[0] * surfaces.smooth[j] + w[1] * surfaces.smooth[j + 1] + w[2] * surfaces.smooth[j + 2]
                if wp.dot(n, n) > 0.0:
                    facing = side * wp.normalize(turn * n)
        return albedo, facing

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
        casters: Casters,
        cached_triangle: wp.array3d(dtype=int),
        cached_lit: wp.array3d(dtype=wp.uint32),
        cached_colour: wp.array3d(dtype=wp.vec3),
        radiance: wp.array3d(dtype=pixel),
        not_finite: wp.array(dtype=int),
        clipped: wp.array(dtype=int),
    ):
        hit = packed[env, y, x]
        t = triangle_of(hit)
        colour = surfaces.environment
        if t != MISS:
            i = surfaces.instance[t]
            d = pixel_ray(view, x, y)
            p = depth_of(hit) * d
            turn = rotation[env, i]
            normal = turn * surfaces.normals[t]
            side = wp.where(wp.dot(normal, d) > 0.0, -1.0, 1.0)
            normal = side * normal
            # What a shadow ray leaves out: a surface that cannot shade itself on this side.
            alone = wp.int32(-1)
            lift = p
            # Casters from this one on may have moved.
            moved = wp.int32(0)
            last = wp.int32(0)
            known = wp.bool(False)
            reached = wp.bool(False)
            bits = wp.uint32(0)
            if wp.static(shadows):
                shell = casters.shell[i]
                if shell == PLANAR or (shell == CONVEX and side > 0.0):
                    alone = i
                lift = p + (OFFSET * (wp.length(p) + casters.radius[i])) * normal
                last = casters.order.shape[0]
            if wp.static(cache):
                moved = casters.still
                known = cached_triangle[env, y, x] == t
                if known:
                    bits = cached_lit[env, y, x]
                    reached = True
                    if wp.static(shadows):
                        reached = unhidden(lights, casters, rotation, translation, env, bits, alone, p, lift)
            if reached:
                colour = cached_colour[env, y, x]
            else:
                albedo, facing = surface(vertices, surfaces, env, t, i, d, turn, side, normal)
                glow = surfaces.emission[surfaces.material[i]] + wp.cw_mul(albedo, surfaces.environment)
                irradiance = wp.vec3(0.0, 0.0, 0.0)
                # The same without moving casters.
                unblocked = wp.vec3(0.0, 0.0, 0.0)
                if wp.static(lit):
                    for l in range(lights.kind.shape[0]):
                        ray, length, strength = towards(lights, env, l, p)
                        cosine = wp.dot(facing, ray)
                        if cosine > 0.0 and wp.dot(normal, ray) > 0.0:
                            share = (cosine * strength) * lights.colour[l]
                            open = wp.bool(True)
                            free = wp.bool(True)
                            if wp.static(shadows):
                                if lights.shadow[l] == 1:
                                    if wp.static(cache):
                                        bit = wp.uint32(1) << wp.uint32(l)
                                        if known:
                                            open = (bits & bit) != wp.uint32(0)
                                        else:
                                            open = not occluded(
                                                casters, rotation, translation, env, 0, moved, alone, lift, ray, length
                                            )
                                            bits = wp.where(open, bits | bit, bits)
                                    free = open
                                    if open:
                                        free = not occluded(
                                            casters, rotation, translation, env, moved, last, alone, lift, ray, length
                                        )
                            if open:
                                unblocked += share
                            if free:
                                irradiance += share
                colour = glow + wp.cw_mul(albedo, irradiance) / PI
                if wp.static(cache):
                    if not known:
                        cached_triangle[env, y, x] = wp.where(casters.is_still[i] == 1, t, MISS)
                        cached_lit[env, y, x] = bits
                        cached_colour[env, y, x] = glow + wp.cw_mul(albedo, unblocked) / PI
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
        casters: Casters,
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
        for x in range(part * span, wp.min(part * span + span, view.width)):
            shade_pixel(
                view, env, row0 + row, x, band, packed, vertices, rotation, translation, surfaces, lights, casters,
                cached_triangle, cached_lit, cached_colour, radiance, not_finite, clipped,
            )  # fmt: skip

    return shade
