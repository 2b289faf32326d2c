"""Finds pixels so close to the outline of something that moves along it that its corners come and go between probes."""

import warp as wp

from nodes.interpolator.refine.evaluation.visibility_kernels import OUTSIDE, weights_then
from nodes.interpolator.refine.paths.motion_kernels import path_length_of
from nodes.interpolator.refine.window_kernels import (
    PixelInterval,
    WindowParameters,
    WindowScene,
    end_entries_of,
    entry_at,
    entry_before,
    pixel_interval_at,
    probe_spacing,
    rows_of,
)
from nodes.interpolator.rigid.plan_kernels import same_surface
from nodes.renderer.raster.depth_kernels import MISS, NO_ENTRY, depth_of, triangle_of
from nodes.renderer.raster.lens.view_kernels import CameraView

wp.set_module_options({"enable_backward": False})

CLOSE = wp.constant(0.05)
"""Distance from an outline, of the way to the next pixel, up to which a pixel grazes it."""
QUICK = wp.constant(1.0)
"""Way [px] from one probe to the next up to which those see what corners pass: shorter sides are none to speak of."""
MOST_ACROSS = wp.constant(4)
"""Most triangles of a patch, one beside the other, that are passed on the way to its outline."""


@wp.func
def entry_then(params: WindowParameters, scene: WindowScene, px: PixelInterval, i: int):
    """Reads the z-buffer entry at a probe, instant i, or at an end of the coarse interval."""
    if i > 0 and i <= params.slots:
        return entry_at(params, scene, px, i)
    ends = end_entries_of(params, scene, px)
    if i == 0:
        return ends.before
    return ends.after


@wp.func
def nearer(a: wp.uint64, b: wp.uint64):
    """Tells whether entry a is nearer than entry b."""
    if triangle_of(a) == MISS:
        return False
    return triangle_of(b) == MISS or depth_of(a) < depth_of(b)


@wp.func
def place_beside(view: CameraView, px: PixelInterval, side: int):
    """Gives column and row of the pixel to the right, to the left, below or above, and whether there is one."""
    x = px.x + wp.where(side == 0, 1, 0) - wp.where(side == 1, 1, 0)
    y = px.y + wp.where(side == 2, 1, 0) - wp.where(side == 3, 1, 0)
    there = x >= 0 and y >= 0 and x < view.width and y < view.height
    return wp.clamp(x, 0, view.width - 1), wp.clamp(y, 0, view.height - 1), there


@wp.func
def neighbour_of(view: CameraView, params: WindowParameters, px: PixelInterval, side: int):
    """Makes the PixelInterval of that pixel."""
    x, y, there = place_beside(view, px, side)
    return pixel_interval_at(view, params, px.env, px.k, y - params.margin, x - params.margin), there


@wp.func
def silhouette_beside(
    view: CameraView,
    params: WindowParameters,
    scene: WindowScene,
    px: PixelInterval,
    side: int,
    low: int,
    high: int,
    before: wp.uint64,
):
    """Gives the z-buffer entry that the pixel on one side shows where an outline lies between the two that stays there,
    while other triangles come by on the nearer side of it, and NO_ENTRY elsewhere.

    low, high: instants of two probes, or ends of the coarse interval; before: the pixel's own entry at `low`.
    """
    found = wp.uint64(NO_ENTRY)
    other, there = neighbour_of(view, params, px, side)
    if there:
        hit = entry_then(params, scene, other, low)
        if triangle_of(hit) != triangle_of(before) and not same_surface(hit, before, scene.targets.pieces):
            on = other
            over = hit
            if nearer(before, hit):
                on = px
                over = before
            ends = end_entries_of(params, scene, on)
            shown = triangle_of(ends.before)
            passes = shown != triangle_of(ends.after)
            if not passes:
                # It may have gone by a whole turn.
                first = probe_spacing(params, scene, px.env)
                passes = shown != triangle_of(entry_then(params, scene, on, first))
            if passes:
                then = entry_then(params, scene, other, high)
                if path_length_of(params, scene, px, over) > QUICK * float(scene.probes[px.env]):
                    if same_surface(hit, then, scene.targets.pieces):
                        found = hit
    return found


@wp.func
def is_beside_silhouette(
    view: CameraView,
    params: WindowParameters,
    scene: WindowScene,
    px: PixelInterval,
    before: wp.uint64,
):
    """Tells whether there is such an outline on any side for a coarse interval; arguments as of `silhouette_beside`."""
    found = wp.bool(False)
    # In a loop that is not unrolled, for a GPU's cache of instructions.
    side = wp.int32(0)
    while side < 4 and not found:
        x, y, there = place_beside(view, px, side)
        if there:
            # Mostly it is one triangle: then there is no need of the other pixel's ray.
            hit = entry_before(params, scene, px.env, px.k, y - params.margin, x - params.margin)
            if triangle_of(hit) != triangle_of(before):
                found = silhouette_beside(view, params, scene, px, side, 0, params.slots + 1, before) != NO_ENTRY
        side += 1
    return found


@wp.func
def share_to_silhouette(
    view: CameraView,
    params: WindowParameters,
    scene: WindowScene,
    px: PixelInterval,
    i: int,
    t: int,
    inside: wp.vec3,
    outside: wp.vec3,
):
    """Computes where the way from a ray that meets a patch at triangle t to one that does not leaves it, as a share of
    the way, at instant i of a coarse interval; -1 where it does not."""
    rows = rows_of(params, px.env, px.k, i)
    present = t
    share = wp.float32(-1.0)
    left = wp.int32(MOST_ACROSS)
    while left > 0:
        left -= 1
        _depth, here = weights_then(view, scene.targets, rows, present, inside)
        _beyond, there = weights_then(view, scene.targets, rows, present, outside)
        edge = wp.int32(0)
        if there[1] < there[edge]:
            edge = 1
        if there[2] < there[edge]:
            edge = 2
        if wp.min(there) <= OUTSIDE or wp.min(here) <= OUTSIDE:
            # It faces away, as what lies beyond the outline of something round does.
            left = 0
        elif there[edge] >= 0.0:
            share = -1.0
            left = 0
        else:
            share = here[edge] / (here[edge] - there[edge])
            present = scene.targets.neighbours[present][edge]
            if present < 0:
                left = 0
    return share


@wp.func
def entry_across_side(
    view: CameraView,
    params: WindowParameters,
    scene: WindowScene,
    px: PixelInterval,
    side: int,
    low: int,
    high: int,
    before: wp.uint64,
):
    """Gives the z-buffer entry of the other side of an outline that a pixel grazes on one side, NO_ENTRY where there is
    none; arguments as of `silhouette_beside`."""
    hit = silhouette_beside(view, params, scene, px, side, low, high, before)
    share = wp.float32(-1.0)
    if hit != NO_ENTRY:
        other, _there = neighbour_of(view, params, px, side)
        if nearer(before, hit):
            share = share_to_silhouette(view, params, scene, px, low, triangle_of(before), px.d, other.d)
        else:
            share = 1.0 - share_to_silhouette(view, params, scene, px, low, triangle_of(hit), other.d, px.d)
    if share >= 0.0 and share < CLOSE:
        return hit
    return NO_ENTRY


@wp.func
def entry_across_silhouette(
    view: CameraView,
    params: WindowParameters,
    scene: WindowScene,
    px: PixelInterval,
    low: int,
    high: int,
    before: wp.uint64,
):
    """Gives the z-buffer entry of the other side of the first outline that a pixel grazes, NO_ENTRY where there is
    none; arguments as of `silhouette_beside`."""
    # Not begun with NO_ENTRY: Warp would write what the loop finds into the constant that it is compared with.
    found = before
    grazes = wp.bool(False)
    side = wp.int32(0)
    while side < 4 and not grazes:
        hit = entry_across_side(view, params, scene, px, side, low, high, before)
        grazes = hit != NO_ENTRY
        if grazes:
            found = hit
        side += 1
    return wp.where(grazes, found, NO_ENTRY)
