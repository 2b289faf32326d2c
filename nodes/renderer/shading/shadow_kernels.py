"""Casts rays from what is seen to point-like lights, in a pass of their own.

On a GPU neighbouring pixels' rays to one light go through the same of the trees at the same time, and a kernel that
does nothing else leaves room for more of them at once than the one that shades.
"""

from functools import cache

import warp as wp

from nodes.renderer.lights.light_kernels import Lights, make_light_directions
from nodes.renderer.lights.surface_point_kernels import SurfacePoint, with_ray_origin
from nodes.renderer.raster.depth_kernels import MISS, depth_of, triangle_of
from nodes.renderer.raster.lens.view_kernels import CameraView, pixel_ray, tile_pixel
from nodes.renderer.raster.surface_kernels import listed_pixel, surface_hit
from nodes.renderer.shadows.grid_kernels import Grid, hidden_from
from nodes.renderer.shadows.ray_kernels import Casters, make_occlusion

wp.set_module_options({"enable_backward": False})


@wp.struct
class Receivers:
    """Holds what shadow rays start from: z-buffer [E, H, W], instance and normal of each triangle, rotation [E, I] of
    the instances to the camera frame; and the lights `shadowed` that they go to."""

    packed: wp.array3d(dtype=wp.uint64)
    instance: wp.array(dtype=int)
    normals: wp.array(dtype=wp.vec3)
    rotation: wp.array2d(dtype=wp.mat33)
    shadowed: wp.array(dtype=int)


@cache
def make_shadow_rays(
    directional: bool, point: bool, spot: bool, trees: bool, grids: bool, fast_math: bool
) -> tuple[wp.Kernel, wp.Kernel]:
    """Makes the kernels `shadow_rays`, of all pixels, and `listed_shadow_rays` with only what a scene has. grids: the
    lights in `shadowed` are those of `grid`, in that order. fast_math: as of Features."""
    light_direction, cannot_reach = make_light_directions(directional, point, spot)
    occluded, _ = make_occlusion(trees, False)

    @wp.func
    def trace(
        view: CameraView,
        env: int,
        y: int,
        x: int,
        n: int,
        receivers: Receivers,
        lights: Lights,
        casters: Casters,
        grid: Grid,
        shadow_mask: wp.array3d(dtype=wp.uint32),
    ):
        """Sets bit l of a pixel from which light l = shadowed[n] is not seen though it might be."""
        l = receivers.shadowed[n]
        entry = receivers.packed[env, y, x]
        t = triangle_of(entry)
        if t == MISS:
            return
        i = receivers.instance[t]
        d = pixel_ray(view, x, y)
        hit = surface_hit(t, i, receivers.rotation[env, i], receivers.normals[t], d, depth_of(entry) * d)
        s = SurfacePoint()
        s.position = hit.position
        s.normal = hit.normal
        # The shading normal is not known here; it can only spare more rays.
        s.shading_normal = hit.normal
        if cannot_reach(lights, env, l, s):
            return
        ray, length, strength = light_direction(lights, env, l, s.position)
        if wp.dot(s.normal, ray) > 0.0 and strength > 0.0:
            s = with_ray_origin(casters, s, hit)
            blocked = wp.bool(False)
            if wp.static(grids):
                blocked = hidden_from(casters, grid, n, env, s.skip_instance, s.ray_origin, ray, length)
            else:
                blocked = occluded(casters, env, 0, casters.order.shape[0], s.skip_instance, s.ray_origin, ray, length)
            if blocked:
                wp.atomic_or(shadow_mask, env, y, x, wp.uint32(1) << wp.uint32(l))

    # Somewhat fewer registers than it would take let more rays run at once.
    registers = 80 if grids else 96
    options = {"fast_math": fast_math}

    @wp.kernel(module="unique", enable_backward=False, cuda_max_registers=registers, module_options=options)
    def shadow_rays(
        # in
        view: CameraView,
        receivers: Receivers,
        lights: Lights,
        casters: Casters,
        grid: Grid,
        # out
        shadow_mask: wp.array3d(dtype=wp.uint32),
    ):
        """Finds which of the lights receivers.shadowed are hidden from each pixel.

        Args:
            receivers: what the rays start from.
            casters: what may be in the way; grid: the same by light, if made with grids.
            shadow_mask: [E, H, W] bit l is set where light l is hidden; all 0 before.
        """
        n, env, tile, lane = wp.tid()
        y, x = tile_pixel(view, tile, lane)
        if y >= view.height or x >= view.width:
            return
        trace(view, env, y, x, n, receivers, lights, casters, grid, shadow_mask)

    @wp.kernel(module="unique", enable_backward=False, cuda_max_registers=registers, module_options=options)
    def listed_shadow_rays(
        # in
        view: CameraView,
        receivers: Receivers,
        lights: Lights,
        casters: Casters,
        grid: Grid,
        workers: int,
        pixels: wp.array(dtype=int),
        count: wp.array(dtype=int),
        # out
        shadow_mask: wp.array3d(dtype=wp.uint32),
    ):
        """Finds the lights that are hidden from listed pixels.

        Args:
            workers: threads that share the list, for each light.
            pixels: indices into [E, H, W].
            count: [1] how many there are.
            shadow_mask: as of `shadow_rays`.
        """
        n, j = wp.tid()
        while j < count[0]:
            pixel = listed_pixel(view, pixels[j])
            trace(view, pixel.env, pixel.y, pixel.x, n, receivers, lights, casters, grid, shadow_mask)
            j += workers

    return shadow_rays, listed_shadow_rays
