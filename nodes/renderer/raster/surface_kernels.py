"""Computes what a pixel sees of a surface: a triangle, a point of it, and its albedo and shading normal there."""

from functools import cache
from typing import Any

import warp as wp

from evis.gpu.reading_kernels import vector_two
from nodes.renderer.raster.depth_kernels import depth_of, triangle_of
from nodes.renderer.raster.lens.view_kernels import CameraView, pixel_ray, ray_steps
from nodes.renderer.raster.triangle_kernels import corners_of, edge_normal
from nodes.renderer.textures.texture_kernels import Textures, filtered

wp.set_module_options({"enable_backward": False})


@wp.struct
class Surfaces:
    """Holds what the triangles look like; material is per instance; gloss (alpha, metallic) is the material's.

    uv, smooth (shading normals) and tint (what the albedo is multiplied by) are per corner [3 T], or have no elements.
    """

    instance: wp.array(dtype=int)
    triangles: wp.array(dtype=wp.vec3i)
    normals: wp.array(dtype=wp.vec3)
    uv: wp.array(dtype=wp.vec2)
    smooth: wp.array(dtype=wp.vec3)
    tint: wp.array(dtype=wp.vec3)
    material: wp.array(dtype=int)
    albedo: wp.array(dtype=wp.vec3)
    emission: wp.array(dtype=wp.vec3)
    gloss: wp.array(dtype=wp.vec2)
    textures: Textures


@wp.struct
class VisibilityBuffer:
    """Holds what the pixels show: depth and triangle, packed, uint64 [E, H, W] (depth_kernels), vertices, and the
    instances' poses [E, I] in the camera frame.

    shadow_mask: of shadow_kernels, bits [E, H, W] of the lights that are hidden from a pixel; may have no elements.
    """

    packed: wp.array3d(dtype=wp.uint64)
    vertices: wp.array2d(dtype=wp.vec3)
    rotation: wp.array2d(dtype=wp.mat33)
    translation: wp.array2d(dtype=wp.vec3)
    shadow_mask: wp.array3d(dtype=wp.uint32)


@wp.struct
class Pixel:
    """Holds the index of a pixel of [E, H, W]."""

    env: int
    y: int
    x: int


@wp.struct
class SurfaceHit:
    """Holds where a pixel's ray meets a triangle, in the camera frame.

    ray: through `position`. rotation: of the instance, to the camera frame. normal: geometric, towards the viewer.
    side: -1 where that is the triangle's back, otherwise 1.
    """

    triangle: int
    instance: int
    ray: wp.vec3
    position: wp.vec3
    rotation: wp.mat33
    normal: wp.vec3
    side: float


@wp.struct
class Barycentric:
    """Holds the barycentric coordinates w of where a ray d meets a triangle: w = (e0 . d, e1 . d, e2 . d) / total."""

    w: wp.vec3
    e0: wp.vec3
    e1: wp.vec3
    e2: wp.vec3
    total: float


@wp.func
def pixel_at(env: int, y: int, x: int):
    """Makes the index of a pixel."""
    p = Pixel()
    p.env = env
    p.y = y
    p.x = x
    return p


@wp.func
def listed_pixel(view: CameraView, at: int):
    """Gives the pixel of an index into [E, H, W]."""
    return pixel_at(at // (view.width * view.height), at // view.width % view.height, at % view.width)


@wp.func
def seen_triangle(seen: VisibilityBuffer, pixel: Pixel):
    """Gives the triangle that a pixel sees, or MISS."""
    return triangle_of(seen.packed[pixel.env, pixel.y, pixel.x])


@wp.func
def side_of(normal: wp.vec3, ray: wp.vec3):
    """Tells which side of a face a ray meets: 1 for the one that its normal points to, -1 for its back."""
    return wp.where(wp.dot(normal, ray) > 0.0, -1.0, 1.0)


@wp.func
def surface_hit(triangle: int, instance: int, rotation: wp.mat33, outward: wp.vec3, ray: wp.vec3, position: wp.vec3):
    """Makes the hit of a ray with a triangle at a position; outward: the triangle's normal in its instance's frame."""
    hit = SurfaceHit()
    normal = rotation * outward
    side = side_of(normal, ray)
    hit.triangle = triangle
    hit.instance = instance
    hit.ray = ray
    hit.position = position
    hit.rotation = rotation
    hit.normal = side * normal
    hit.side = side
    return hit


@wp.func
def hit_of_entry(view: CameraView, seen: VisibilityBuffer, surfaces: Surfaces, pixel: Pixel, entry: wp.uint64):
    """Finds where a pixel's ray meets the triangle of a z-buffer entry; there must be one."""
    t = triangle_of(entry)
    i = surfaces.instance[t]
    ray = pixel_ray(view, pixel.x, pixel.y)
    return surface_hit(t, i, seen.rotation[pixel.env, i], surfaces.normals[t], ray, depth_of(entry) * ray)


@wp.func
def primary_hit(view: CameraView, seen: VisibilityBuffer, surfaces: Surfaces, pixel: Pixel):
    """Finds where a pixel's ray meets the triangle that it sees; there must be one."""
    return hit_of_entry(view, seen, surfaces, pixel, seen.packed[pixel.env, pixel.y, pixel.x])


@wp.func
def barycentric_of(view: CameraView, seen: VisibilityBuffer, surfaces: Surfaces, env: int, hit: SurfaceHit):
    """Computes the barycentric coordinates of a hit, of the ray and not of the rounded position."""
    centre = seen.translation[env, hit.instance]
    a, b, c = corners_of(view, seen.vertices, surfaces.triangles, hit.rotation, centre, env, hit.triangle)
    e0 = edge_normal(b, c)
    e1 = edge_normal(c, a)
    e2 = edge_normal(a, b)
    d = hit.ray
    w = wp.vec3(wp.dot(e0, d), wp.dot(e1, d), wp.dot(e2, d))
    total = w[0] + w[1] + w[2]
    r = Barycentric()
    r.w = w / total
    r.e0 = e0
    r.e1 = e1
    r.e2 = e2
    r.total = total
    return r


@wp.func
def seen_texture(view: CameraView, pixel: Pixel, surfaces: Surfaces, t: int, place: wp.vec2i, r: Barycentric):
    """Gives a texture under a pixel that sees triangle t."""
    j = 3 * t
    uv0 = vector_two(surfaces.uv, j)
    uv1 = vector_two(surfaces.uv, j + 1)
    uv2 = vector_two(surfaces.uv, j + 2)
    w = r.w
    uv = w[0] * uv0 + w[1] * uv1 + w[2] * uv2
    # The weights are linear in d before they are divided by their sum.
    right, below = ray_steps(view, pixel.x, pixel.y)
    right = right / r.total
    below = below / r.total
    e0 = r.e0
    e1 = r.e1
    e2 = r.e2
    across = wp.dot(e0, right) * (uv0 - uv) + wp.dot(e1, right) * (uv1 - uv)
    across += wp.dot(e2, right) * (uv2 - uv)
    down = wp.dot(e0, below) * (uv0 - uv) + wp.dot(e1, below) * (uv1 - uv)
    down += wp.dot(e2, below) * (uv2 - uv)
    return filtered(surfaces.textures, place, uv, across, down)


@wp.func
def smooth_normal(surfaces: Surfaces, t: int, w: wp.vec3):
    """Makes the shading normal of triangle t in the instance's frame, of any length; 0 where it has none of its own."""
    j = 3 * t
    return w[0] * surfaces.smooth[j] + w[1] * surfaces.smooth[j + 1] + w[2] * surfaces.smooth[j + 2]


@wp.func
def tint_of(surfaces: Surfaces, t: int, w: wp.vec3):
    """Gives the colour of triangle t: exact where its corners have one colour, and never outside 0 ... 1 by
    rounding."""
    c = surfaces.tint[3 * t + 2]
    tint = c + w[0] * (surfaces.tint[3 * t] - c) + w[1] * (surfaces.tint[3 * t + 1] - c)
    return wp.min(wp.max(tint, wp.vec3(0.0, 0.0, 0.0)), wp.vec3(1.0, 1.0, 1.0))


@wp.func
def shading_normal_of(surfaces: Surfaces, hit: SurfaceHit, w: wp.vec3):
    """Gives the shading normal, towards the viewer, at barycentric coordinates w; the geometric one where a mesh has no
    other."""
    n = smooth_normal(surfaces, hit.triangle, w)
    if wp.dot(n, n) > 0.0:
        return hit.side * wp.normalize(hit.rotation * n)
    return hit.normal


@cache
def make_surface_at(textures: bool, smooth: bool, vertex_colours: bool) -> Any:
    """Makes the function `surface_at`."""

    @wp.func
    def surface_at(view: CameraView, pixel: Pixel, surfaces: Surfaces, hit: SurfaceHit, r: Barycentric):
        """Gives the albedo, and shading normal towards the viewer, at barycentric coordinates of a hit."""
        albedo = surfaces.albedo[surfaces.material[hit.instance]]
        shading_normal = hit.normal
        if wp.static(textures):
            place = surfaces.textures.place[hit.instance]
            if place[1] > 0:
                albedo = wp.cw_mul(albedo, seen_texture(view, pixel, surfaces, hit.triangle, place, r))
        if wp.static(vertex_colours):
            albedo = wp.cw_mul(albedo, tint_of(surfaces, hit.triangle, r.w))
        if wp.static(smooth):
            shading_normal = shading_normal_of(surfaces, hit, r.w)
        return albedo, shading_normal

    return surface_at


@cache
def make_surface(textures: bool, smooth: bool, vertex_colours: bool) -> Any:
    """Makes the function `surface`."""
    surface_at = make_surface_at(textures, smooth, vertex_colours)

    @wp.func
    def surface(view: CameraView, pixel: Pixel, seen: VisibilityBuffer, surfaces: Surfaces, hit: SurfaceHit):
        """Gives the albedo, and shading normal towards the viewer, where a pixel sees a triangle."""
        r = Barycentric()
        if wp.static(textures or smooth or vertex_colours):
            r = barycentric_of(view, seen, surfaces, pixel.env, hit)
        return surface_at(view, pixel, surfaces, hit, r)

    return surface
