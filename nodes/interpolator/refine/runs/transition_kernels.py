"""Finds the instants between which pixels pass from one surface to another: between two probes, by bisection."""

from functools import cache

import warp as wp

from evis.gpu.append_kernels import take_place
from nodes.interpolator.refine.evaluation.visibility_kernels import make_trace_between
from nodes.interpolator.refine.runs.silhouette_kernels import entry_across_silhouette
from nodes.interpolator.refine.samples.list_kernels import ListPart, end_of, take_entry
from nodes.interpolator.refine.window_kernels import (
    FEW_REGISTERS,
    WindowParameters,
    WindowScene,
    end_entries_of,
    entry_at,
    pixel_interval_of,
    slot_row,
)
from nodes.interpolator.rigid.plan_kernels import same_surface
from nodes.renderer.raster.depth_kernels import MISS, NO_ENTRY, depth_of, triangle_of
from nodes.renderer.raster.lens.view_kernels import CameraView

wp.set_module_options({"enable_backward": False})

MOST_PENDING = wp.constant(16)
"""Ends of parts of an interval between probes that are still to be looked at: some more than it can be halved."""
PENDING = wp.types.vector(length=MOST_PENDING, dtype=wp.int32)
SEEN_THEN = wp.types.vector(length=MOST_PENDING, dtype=wp.uint64)
APART = wp.constant(1.001)
"""How much farther something is that was behind what left it free, at least."""


@wp.struct
class ChangingPixels:
    """Holds a list of pixels that show several surfaces in a coarse interval.

    at: indices into [coarse intervals, E, h, w]. grazing: 1 of those that `is_beside_silhouette` tells of. first: index
    of the first change of each pixel and probe, -1 = none. begun, seen, opened: of each pixel's last run, as of
    Transitions.
    """

    at: wp.array(dtype=int)
    grazing: wp.array(dtype=int)
    first: wp.array(dtype=int)
    begun: wp.array(dtype=int)
    seen: wp.array(dtype=wp.uint64)
    opened: wp.array(dtype=int)


@wp.struct
class Transitions:
    """Holds a list of changes from one surface to another.

    job: index of the pixel in ChangingPixels. low: the last instant of the old surface. before, after: z-buffer entries
    at `low` and at the next instant. later: time of the change, in PARTS after `low`. following: index
    of the next change between the same probes, -1 = none. limb: where the change is at the outline of something round,
    whose light is another one there, the triangle t that has the outline: t where it is of the old surface, -2 - t
    where it is of the new one; -1 elsewhere. weights: of the corners of t, at that point of the outline.

    Of the run of the old surface: begun, the instant at which it begins, at the end of the interval where there is no
    such run; seen, the z-buffer entry there. opened, closed: where the samples at both of its ends are in the list of
    Requests, -1 = at a coarse frame.
    """

    job: wp.array(dtype=int)
    low: wp.array(dtype=int)
    before: wp.array(dtype=wp.uint64)
    after: wp.array(dtype=wp.uint64)
    later: wp.array(dtype=int)
    following: wp.array(dtype=int)
    limb: wp.array(dtype=int)
    weights: wp.array(dtype=wp.vec3)
    begun: wp.array(dtype=int)
    seen: wp.array(dtype=wp.uint64)
    opened: wp.array(dtype=int)
    closed: wp.array(dtype=int)


@wp.kernel(module="unique", enable_backward=False)
def find_changed_spans(
    # in
    view: CameraView,
    params: WindowParameters,
    workers: int,
    scene: WindowScene,
    changing: ChangingPixels,
    changing_part: ListPart,
    # out
    transitions: Transitions,
    out: ListPart,
    changed_spans: wp.array(dtype=int),
):
    """Lists between which probes pixels that show several surfaces pass from one to another.

    transitions: the number of the probe in `low`, the entries at both ends in `before` and `after`, that of the other
    side of an outline that the pixel grazes, or NO_ENTRY, in `seen`, and the pixel; written to a part of the list.
    changed_spans [bands]: how many of these there are, also where there is no room for all.
    """
    job = wp.tid()
    while job < (end_of(changing_part) - changing_part.start) * params.probes:
        n = job % params.probes
        listed = changing_part.start + job // params.probes
        px = pixel_interval_of(view, params, changing.at[listed])
        ends = end_entries_of(params, scene, px)
        probes = scene.probes[px.env]
        changing.first[listed * params.probes + n] = -1
        if n < probes:
            hit = ends.before
            then = ends.after
            if n > 0:
                hit = entry_at(params, scene, px, n * (params.slots + 1) // probes)
            if n + 1 < probes:
                then = entry_at(params, scene, px, (n + 1) * (params.slots + 1) // probes)
            beside = wp.uint64(NO_ENTRY)
            if changing.grazing[listed] == 1:
                each = (params.slots + 1) // probes
                beside = entry_across_silhouette(view, params, scene, px, n * each, (n + 1) * each, hit)
            if beside != NO_ENTRY or not same_surface(hit, then, scene.targets.pieces):
                place = take_entry(out)
                take_place(changed_spans, out.band)
                if place < out.room:
                    place += out.start
                    transitions.job[place] = listed
                    transitions.low[place] = n
                    transitions.before[place] = hit
                    transitions.after[place] = then
                    transitions.seen[place] = beside
                    changing.first[listed * params.probes + n] = place
        job += workers


@wp.func
def farther(a: wp.uint64, b: wp.uint64):
    """Tells whether entry a is farther than b, by more than two sides of an edge are."""
    if triangle_of(b) == MISS:
        return False
    return triangle_of(a) == MISS or depth_of(a) > APART * depth_of(b)


@wp.func
def halvings(length: int):
    """Counts how often an interval can be halved, for which so many ends wait at most."""
    count = wp.int32(0)
    while (1 << count) < length:
        count += 1
    return count


@cache
def make_find_transitions(trees: bool) -> wp.Kernel:
    """Makes the kernel `find_transitions`; trees: as of `make_trace_all`."""
    trace_between = make_trace_between(trees)

    @wp.kernel(module="unique", enable_backward=False, cuda_max_registers=FEW_REGISTERS)
    def find_transitions(
        # in
        view: CameraView,
        params: WindowParameters,
        workers: int,
        changed_spans: wp.array(dtype=int),
        scene: WindowScene,
        # in or out
        changing: ChangingPixels,
        transitions: Transitions,
        out: ListPart,
    ):
        """Finds the changes between two probes, of which `find_changed_spans` has listed changed_spans[band] pairs: the
        first one takes the place of the pair, others those after all. Arguments as of `find_changed_spans`."""
        j = out.start + wp.tid()
        while j < out.start + wp.min(changed_spans[out.band], out.room):
            listed = transitions.job[j]
            px = pixel_interval_of(view, params, changing.at[listed])
            probes = scene.probes[px.env]
            n = transitions.low[j]
            low = n * (params.slots + 1) // probes
            hit = transitions.before[j]
            own = hit
            beside = transitions.seen[j]
            pending = PENDING()
            entries = SEEN_THEN()
            waiting = wp.int32(0)
            pending[0] = (n + 1) * (params.slots + 1) // probes
            entries[0] = transitions.after[j]
            last = wp.int32(-1)
            # The first instant of the present run, whether `hit` is of a z-buffer or a ray at everything there is, and
            # the same of the ends: a bit each.
            begun = low
            sure = wp.bool(True)
            certain = wp.int32(1)
            while waiting >= 0:
                high = pending[waiting]
                then = entries[waiting]
                known = (certain >> waiting) & 1 == 1
                alike = same_surface(hit, then, scene.targets.pieces)
                if alike and (beside == NO_ENTRY or high - low == 1):
                    low = high
                    hit = then
                    sure = known
                    waiting -= 1
                else:
                    ask = wp.int32(-1)
                    wholly = wp.bool(True)
                    if high - low > 1:
                        ask = (low + high) // 2
                        wholly = False
                    elif not known and farther(then, hit):
                        # What was before it is gone: now a third thing may be there.
                        ask = high
                    elif not sure and farther(hit, then):
                        ask = low
                    if ask >= 0:
                        row = slot_row(params, px.env, px.k, ask)
                        ahead = hit
                        behind = then
                        if ask == high:
                            ahead = then
                        if ask == low:
                            behind = hit
                        if alike and beside != NO_ENTRY:
                            # A ray that just misses the surface of both entries would be taken to meet it.
                            behind = beside
                            if same_surface(hit, beside, scene.targets.pieces):
                                behind = own
                        seen = trace_between(view, scene.targets, row, px.d, ahead, behind, wholly)
                        if ask == low:
                            sure = True
                            if not same_surface(hit, seen, scene.targets.pieces):
                                if low == begun or waiting + 2 + halvings(low - begun) > MOST_PENDING:
                                    hit = seen
                                    if last >= 0:
                                        transitions.after[last] = hit
                                else:
                                    waiting += 1
                                    pending[waiting] = low
                                    entries[waiting] = seen
                                    certain = certain | (1 << waiting)
                                    low = begun
                        else:
                            if not wholly:
                                waiting += 1
                                pending[waiting] = ask
                                certain = certain & ~(1 << waiting)
                            else:
                                certain = certain | (1 << waiting)
                            entries[waiting] = seen
                    else:
                        place = j
                        if last >= 0:
                            place = out.start + take_entry(out)
                        if place < out.start + out.room:
                            if last >= 0:
                                transitions.following[last] = place
                            transitions.job[place] = listed
                            transitions.low[place] = low
                            transitions.before[place] = hit
                            transitions.after[place] = then
                            transitions.following[place] = -1
                            last = place
                        low = high
                        hit = then
                        begun = high
                        sure = known
                        waiting -= 1
            if last < 0:
                # Step by step it is one surface after all.
                changing.first[listed * params.probes + n] = -1
                transitions.begun[j] = params.slots + 1
            j += workers

    return find_transitions
