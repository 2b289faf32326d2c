"""Finds pixels so close to the outline of something that moves along it that its corners come and go between probes."""

import warp as wp

from nodes.interpolator.refine.evaluation.visibility_kernels import OUTSIDE, weights_then
from nodes.interpolator.refine.paths.motion_kernels import way_of
from nodes.interpolator.refine.window_kernels import (
    Cut,
    Spot,
    Stage,
    ends_of,
    entry_at,
    entry_before,
    slot_row,
    spot_at,
)
from nodes.interpolator.rigid.plan_kernels import joined
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
def entry_then(cut: Cut, stage: Stage, start: wp.array3d(dtype=wp.uint64), spot: Spot, i: int):
    """Reads the z-buffer entry at a probe, instant i, or at an end of the coarse interval."""
    if i > 0 and i <= cut.slots:
        return entry_at(cut, stage, spot, i)
    ends = ends_of(cut, stage, start, spot)
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
def place_beside(view: CameraView, spot: Spot, side: int):
    """Gives column and row of the pixel to the right, to the left, below or above, and whether there is one."""
    x = spot.x + wp.where(side == 0, 1, 0) - wp.where(side == 1, 1, 0)
    y = spot.y + wp.where(side == 2, 1, 0) - wp.where(side == 3, 1, 0)
    there = x >= 0 and y >= 0 and x < view.width and y < view.height
    return wp.clamp(x, 0, view.width - 1), wp.clamp(y, 0, view.height - 1), there


@wp.func
def neighbour_of(view: CameraView, cut: Cut, spot: Spot, side: int):
    """Makes the Spot of that pixel."""
    x, y, there = place_beside(view, spot, side)
    return spot_at(view, cut, spot.env, spot.k, y - cut.margin, x - cut.margin), there


@wp.func
def outline_beside(
    view: CameraView,
    cut: Cut,
    stage: Stage,
    start: wp.array3d(dtype=wp.uint64),
    spot: Spot,
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
    other, there = neighbour_of(view, cut, spot, side)
    if there:
        hit = entry_then(cut, stage, start, other, low)
        if triangle_of(hit) != triangle_of(before) and not joined(hit, before, stage.targets.pieces):
            on = other
            over = hit
            if nearer(before, hit):
                on = spot
                over = before
            ends = ends_of(cut, stage, start, on)
            shown = triangle_of(ends.before)
            passes = shown != triangle_of(ends.after)
            if not passes:
                # It may have gone by a whole turn.
                first = (cut.slots + 1) // stage.probes[spot.env]
                passes = shown != triangle_of(entry_then(cut, stage, start, on, first))
            if passes:
                then = entry_then(cut, stage, start, other, high)
                if way_of(cut, stage, spot, over) > QUICK * float(stage.probes[spot.env]):
                    if joined(hit, then, stage.targets.pieces):
                        found = hit
    return found


@wp.func
def beside_outline(
    view: CameraView,
    cut: Cut,
    stage: Stage,
    start: wp.array3d(dtype=wp.uint64),
    spot: Spot,
    before: wp.uint64,
):
    """Tells whether there is such an outline on any side for a coarse interval; arguments as of `outline_beside`."""
    found = wp.bool(False)
    # In a loop that is not unrolled, for a GPU's cache of instructions.
    side = wp.int32(0)
    while side < 4 and not found:
        x, y, there = place_beside(view, spot, side)
        if there:
            # Mostly it is one triangle: then there is no need of the other pixel's ray.
            hit = entry_before(cut, stage, start, spot.env, spot.k, y - cut.margin, x - cut.margin)
            if triangle_of(hit) != triangle_of(before):
                found = outline_beside(view, cut, stage, start, spot, side, 0, cut.slots + 1, before) != NO_ENTRY
        side += 1
    return found


@wp.func
def way_to_outline(
    view: CameraView, cut: Cut, stage: Stage, spot: Spot, i: int, t: int, inside: wp.vec3, outside: wp.vec3
):
    """Computes where the way from a ray that meets a patch at triangle t to one that does not leaves it, as a share of
    the way, at instant i of a coarse interval; -1 where it does not."""
    rows = wp.vec2i(slot_row(cut, spot.env, spot.k, wp.clamp(i, 1, cut.slots)), -1)
    if i == 0:
        rows[1] = slot_row(cut, spot.env, spot.k, 2)
    present = t
    share = wp.float32(-1.0)
    left = wp.int32(MOST_ACROSS)
    while left > 0:
        left -= 1
        _depth, here = weights_then(view, stage.targets, rows, present, inside)
        _beyond, there = weights_then(view, stage.targets, rows, present, outside)
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
            present = stage.targets.neighbours[present][edge]
            if present < 0:
                left = 0
    return share


@wp.func
def grazed(
    view: CameraView,
    cut: Cut,
    stage: Stage,
    start: wp.array3d(dtype=wp.uint64),
    spot: Spot,
    low: int,
    high: int,
    before: wp.uint64,
):
    """Gives the z-buffer entry of the other side of an outline that a pixel grazes, NO_ENTRY where there is none;
    arguments as of `outline_beside`."""
    found = wp.uint64(NO_ENTRY)
    side = wp.int32(0)
    while side < 4 and found == NO_ENTRY:
        hit = outline_beside(view, cut, stage, start, spot, side, low, high, before)
        if hit != NO_ENTRY:
            other, _there = neighbour_of(view, cut, spot, side)
            share = wp.float32(-1.0)
            if nearer(before, hit):
                share = way_to_outline(view, cut, stage, spot, low, triangle_of(before), spot.d, other.d)
            else:
                share = 1.0 - way_to_outline(view, cut, stage, spot, low, triangle_of(hit), other.d, spot.d)
            if share >= 0.0 and share < CLOSE:
                found = hit
        side += 1
    return found
