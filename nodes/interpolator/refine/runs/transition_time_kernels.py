"""Finds when between two instants pixels pass from one surface to another: over which edge of which triangle."""

from functools import cache

import warp as wp

from nodes.interpolator.refine.evaluation.visibility_kernels import OUTSIDE, Targets, weights_then
from nodes.interpolator.refine.runs.transition_kernels import ChangingPixels, Transitions
from nodes.interpolator.refine.samples.list_kernels import ListPart, end_of
from nodes.interpolator.refine.samples.request_kernels import PARTS, SHARP
from nodes.interpolator.refine.window_kernels import (
    FEW_REGISTERS,
    WindowParameters,
    WindowScene,
    pixel_interval_of,
    rows_of,
)
from nodes.renderer.raster.depth_kernels import MISS, depth_of, triangle_of
from nodes.renderer.raster.lens.view_kernels import CameraView
from nodes.renderer.raster.surface_kernels import smooth_normal

wp.set_module_options({"enable_backward": False})

MOST_BESIDE = wp.constant(96)
"""Most triangles of a patch, one beside the other, that are tried for where a ray leaves it between two instants."""
TURNED = wp.constant(0.995)
"""Cosine of the angle between shading normals, 0.1 rad, from which on an outline has light of its own."""


@wp.func
def crossing(leaves: bool, at_low: wp.vec3, at_high: wp.vec3):
    """Computes when a ray passes over the first edge out of a triangle, or over the last one into it, as a share of the
    time between two instants with these weights of its corners; gives also the edge, -1 = none."""
    share = wp.where(leaves, 1.0, 0.0)
    edge = wp.int32(-1)
    for i in range(3):
        out = at_low[i] >= 0.0 and at_high[i] < 0.0
        into = at_low[i] < 0.0 and at_high[i] >= 0.0
        if (leaves and out) or (into and not leaves):
            then = at_low[i] / (at_low[i] - at_high[i])
            if edge < 0 or (then < share) == leaves:
                share = then
                edge = i
    return share, edge


@wp.func
def leaves_patch(
    view: CameraView,
    targets: Targets,
    low: wp.vec2i,
    high: wp.vec2i,
    d: wp.vec3,
    triangle: int,
    leaves: bool,
    at_low: wp.vec3,
    at_high: wp.vec3,
):
    """Computes when a ray leaves the patch of a triangle between two instants, or comes to it: over the edges of one
    triangle after the other, to one that no other of the patch is beside or whose neighbour faces away. Gives that
    triangle too.

    low, high: the instants, as of `weights_then`. at_low, at_high: weights of the triangle's corners there.
    """
    share, edge = crossing(leaves, at_low, at_high)
    present = triangle
    last = triangle
    left = wp.int32(MOST_BESIDE)
    while left > 0 and edge >= 0:
        left -= 1
        present = targets.neighbours[present][edge]
        edge = wp.int32(-1)
        if present >= 0:
            _z, before = weights_then(view, targets, low, present, d)
            _z, after = weights_then(view, targets, high, present, d)
            if wp.min(wp.min(before), wp.min(after)) > OUTSIDE:
                then, over = crossing(leaves, before, after)
                if over >= 0 and then != share and (then > share) == leaves:
                    share = then
                    edge = over
                    last = present
    return share, last


@wp.func
def transition_time(
    view: CameraView, targets: Targets, low: wp.vec2i, high: wp.vec2i, d: wp.vec3, before: wp.uint64, after: wp.uint64
):
    """Computes when a ray passes from one triangle to another between two instants, as a share of their time: over the
    edge of the patch of either, or where they cut each other.

    low, high: the instants, as of `weights_then`. before, after: z-buffer entries there. 0.5 where neither tells. Gives
    also the triangle with the edge, -1 = none, and whether it is of the old surface.
    """
    t = triangle_of(before)
    u = triangle_of(after)
    unseen = wp.vec3(OUTSIDE, OUTSIDE, OUTSIDE)
    t_low = unseen
    t_high = unseen
    u_low = unseen
    u_high = unseen
    # How much nearer the old triangle is, by inverse distances.
    ahead_low = wp.float32(0.0)
    ahead_high = wp.float32(0.0)
    # In a loop that is not unrolled, for a GPU's cache of instructions.
    k = wp.int32(0)
    while k < 4:
        triangle = wp.where(k < 2, t, u)
        if triangle != MISS:
            rows = high
            if k % 2 == 0:
                rows = low
            nearness, weights = weights_then(view, targets, rows, triangle, d)
            sign = wp.where(k < 2, 1.0, -1.0)
            if k % 2 == 0:
                ahead_low += sign * nearness
            else:
                ahead_high += sign * nearness
            if k == 0:
                t_low = weights
            elif k == 1:
                t_high = weights
            elif k == 2:
                u_low = weights
            else:
                u_high = weights
        k += 1
    leaves = wp.min(t_low) >= 0.0 and wp.min(t_high) < 0.0 and wp.min(t_high) > OUTSIDE
    enters = wp.min(u_low) < 0.0 and wp.min(u_low) > OUTSIDE and wp.min(u_high) >= 0.0
    if leaves and enters:
        leaves = u == MISS or depth_of(before) <= depth_of(after)
    if leaves or enters:
        nearer = u
        if leaves:
            nearer = t
            u_low = t_low
            u_high = t_high
        share, last = leaves_patch(view, targets, low, high, d, nearer, leaves, u_low, u_high)
        return share, last, leaves
    both = wp.min(wp.min(t_low), wp.min(t_high)) >= 0.0 and wp.min(wp.min(u_low), wp.min(u_high)) >= 0.0
    if both and ahead_low > 0.0 and ahead_high < 0.0:
        return ahead_low / (ahead_low - ahead_high), int(MISS), False
    return 0.5, int(MISS), False


@wp.func
def inside(weights: wp.vec3):
    """Gives weights of a triangle's corners that add up to 1, of what lies on it or just beside it."""
    w = wp.max(weights, wp.vec3(0.0, 0.0, 0.0))
    return w / wp.max(w[0] + w[1] + w[2], 1.0e-30)


@wp.func
def point_of_outline(
    view: CameraView,
    scene: WindowScene,
    low: wp.vec2i,
    high: wp.vec2i,
    d: wp.vec3,
    share: float,
    last: int,
    rows: wp.vec2i,
    seen: int,
):
    """Computes where a ray meets triangle `last` at a share of the time between two instants, as weights of its
    corners, and whether the shading normal there is another one than at an instant, `rows`, at which triangle `seen`
    of the same instance is seen."""
    _z, at_low = weights_then(view, scene.targets, low, last, d)
    _z, at_high = weights_then(view, scene.targets, high, last, d)
    _z, then = weights_then(view, scene.targets, rows, seen, d)
    if wp.min(wp.min(at_low), wp.min(at_high)) <= OUTSIDE or wp.min(then) <= OUTSIDE:
        return wp.vec3(0.0, 0.0, 0.0), False
    weights = inside(at_low + share * (at_high - at_low))
    here = smooth_normal(scene.surfaces, last, weights)
    there = smooth_normal(scene.surfaces, seen, inside(then))
    return weights, wp.dot(here, there) < TURNED * wp.length(here) * wp.length(there)


@cache
def make_find_transition_times(limbs: bool) -> wp.Kernel:
    """Makes the kernel `find_transition_times`; limbs: whether light may be another one at the outline of something."""

    @wp.kernel(module="unique", enable_backward=False, cuda_max_registers=FEW_REGISTERS)
    def find_transition_times(
        # in
        view: CameraView,
        params: WindowParameters,
        workers: int,
        scene: WindowScene,
        changing: ChangingPixels,
        # in or out
        transitions: Transitions,
        part: ListPart,
    ):
        """Finds when between two instants the changes of a part of the list are, and which of them are at limbs;
        arguments as of `find_changed_spans`."""
        c = part.start + wp.tid()
        while c < end_of(part):
            px = pixel_interval_of(view, params, changing.at[transitions.job[c]])
            low = transitions.low[c]
            rows_low = rows_of(params, px.env, px.k, low)
            rows_high = rows_of(params, px.env, px.k, low + 1)
            share, last, leaves = transition_time(
                view, scene.targets, rows_low, rows_high, px.d, transitions.before[c], transitions.after[c]
            )
            transitions.later[c] = wp.clamp(int(share * float(PARTS)), SHARP, PARTS - SHARP)
            if wp.static(limbs):
                limb = wp.int32(-1)
                if last >= 0:
                    rows = rows_high
                    seen = triangle_of(transitions.after[c])
                    if leaves:
                        rows = rows_low
                        seen = triangle_of(transitions.before[c])
                    weights, other = point_of_outline(view, scene, rows_low, rows_high, px.d, share, last, rows, seen)
                    if other:
                        limb = wp.where(leaves, last, -2 - last)
                        transitions.weights[c] = weights
                transitions.limb[c] = limb
            c += workers

    return find_transition_times
