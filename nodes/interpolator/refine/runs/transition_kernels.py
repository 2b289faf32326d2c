"""Finds the instants between which pixels pass from one surface to another: between two probes, by bisection."""

from functools import cache

import warp as wp

from evis.gpu.append_kernels import take_place
from nodes.interpolator.refine.evaluation.visibility_kernels import make_seen_between
from nodes.interpolator.refine.runs.silhouette_kernels import grazed
from nodes.interpolator.refine.window_kernels import FEW_REGISTERS, Cut, Stage, ends_of, entry_at, slot_row, spot_of
from nodes.interpolator.rigid.plan_kernels import joined
from nodes.renderer.raster.depth_kernels import MISS, NO_ENTRY, depth_of, triangle_of
from nodes.renderer.raster.lens.view_kernels import CameraView

wp.set_module_options({"enable_backward": False})

MOST_PENDING = wp.constant(16)
APART = wp.constant(1.001)
"""How much farther something is that was behind what left it free, at least."""
PENDING = wp.types.vector(length=16, dtype=wp.int32)
SEEN_THEN = wp.types.vector(length=16, dtype=wp.uint64)
"""Ends of parts of an interval between probes that are still to be looked at: some more than it can be halved."""


@wp.struct
class Several:
    """Holds a list of pixels that show several surfaces in a coarse interval.

    at: indices into [coarse intervals, E, h, w]. grazing: 1 of those that `beside_outline` tells of. first: index of
    the first change of each pixel and probe, -1 = none. begun, seen, opened: of each pixel's last run, as of Changes.
    """

    at: wp.array(dtype=int)
    grazing: wp.array(dtype=int)
    first: wp.array(dtype=int)
    begun: wp.array(dtype=int)
    seen: wp.array(dtype=wp.uint64)
    opened: wp.array(dtype=int)


@wp.struct
class Changes:
    """Holds a list of changes from one surface to another.

    job: index of the pixel in Several. low: the last instant of the old surface. before, after: z-buffer entries at
    `low` and at the next instant. later: time of the change, in PARTS after `low`, 0 = unknown. following: index of the
    next change between the same probes, -1 = none.

    Of the run of the old surface: begun, the instant at which it begins, at the end of the interval where there is no
    such run; seen, the z-buffer entry there. opened, closed: where the samples at both of its ends are in the list of
    Instances, -1 = at a coarse frame.
    """

    job: wp.array(dtype=int)
    low: wp.array(dtype=int)
    before: wp.array(dtype=wp.uint64)
    after: wp.array(dtype=wp.uint64)
    later: wp.array(dtype=int)
    following: wp.array(dtype=int)
    begun: wp.array(dtype=int)
    seen: wp.array(dtype=wp.uint64)
    opened: wp.array(dtype=int)
    closed: wp.array(dtype=int)


@wp.kernel(module="unique", enable_backward=False)
def find_breaks(
    # in
    view: CameraView,
    cut: Cut,
    workers: int,
    room: int,
    most: int,
    others0: int,
    band: int,
    others_count: wp.array(dtype=int),
    stage: Stage,
    start: wp.array3d(dtype=wp.uint64),
    several: Several,
    # out
    changes: Changes,
    count: wp.array(dtype=int),
    breaks: wp.array(dtype=int),
):
    """Lists between which probes pixels that show several surfaces pass from one to another: others_count[band] of
    these, from others0 on.

    changes: the number of the probe in `low`, the entries at both ends in `before` and `after`, that of the other side
    of an outline that the pixel grazes, or NO_ENTRY, in `seen`, and the pixel; written
    from `room` on, at most `most`. count[band], breaks[band]: how many there are, also where that is more than `most`.
    """
    inner = cut.envs * cut.height * cut.width
    job = wp.tid()
    while job < others_count[band] * cut.probes:
        n = job % cut.probes
        listed = others0 + job // cut.probes
        at = several.at[listed]
        spot = spot_of(view, cut, cut.first + at // inner, at % inner)
        ends = ends_of(cut, stage, start, spot)
        probes = stage.probes[spot.env]
        several.first[job + others0 * cut.probes] = -1
        if n < probes:
            hit = ends.before
            then = ends.after
            if n > 0:
                hit = entry_at(cut, stage, spot, n * (cut.slots + 1) // probes)
            if n + 1 < probes:
                then = entry_at(cut, stage, spot, (n + 1) * (cut.slots + 1) // probes)
            beside = wp.uint64(NO_ENTRY)
            if several.grazing[listed] == 1:
                each = (cut.slots + 1) // probes
                beside = grazed(view, cut, stage, start, spot, n * each, (n + 1) * each, hit)
            if beside != NO_ENTRY or not joined(hit, then, stage.targets.pieces):
                place = take_place(count, band)
                take_place(breaks, band)
                if place < most:
                    place += room
                    changes.job[place] = listed
                    changes.low[place] = n
                    changes.before[place] = hit
                    changes.after[place] = then
                    changes.seen[place] = beside
                    several.first[job + others0 * cut.probes] = place
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
def make_find_changes(trees: bool) -> wp.Kernel:
    """Makes the kernel `find_changes`; trees: as of `make_seen_of_all`."""
    seen_between = make_seen_between(trees)

    @wp.kernel(module="unique", enable_backward=False, cuda_max_registers=FEW_REGISTERS)
    def find_changes(
        # in
        view: CameraView,
        cut: Cut,
        workers: int,
        room: int,
        most: int,
        band: int,
        breaks: wp.array(dtype=int),
        stage: Stage,
        # in or out
        several: Several,
        changes: Changes,
        count: wp.array(dtype=int),
    ):
        """Finds the changes between two probes, breaks[band] pairs of which `find_breaks` has listed from `room` on:
        the first one takes the place of the pair, others those after all. Arguments as of `find_breaks`."""
        inner = cut.envs * cut.height * cut.width
        j = room + wp.tid()
        while j < room + wp.min(breaks[band], most):
            listed = changes.job[j]
            at = several.at[listed]
            spot = spot_of(view, cut, cut.first + at // inner, at % inner)
            probes = stage.probes[spot.env]
            n = changes.low[j]
            low = n * (cut.slots + 1) // probes
            hit = changes.before[j]
            own = hit
            beside = changes.seen[j]
            pending = PENDING()
            entries = SEEN_THEN()
            waiting = wp.int32(0)
            pending[0] = (n + 1) * (cut.slots + 1) // probes
            entries[0] = changes.after[j]
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
                alike = joined(hit, then, stage.targets.pieces)
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
                        row = slot_row(cut, spot.env, spot.k, ask)
                        ahead = hit
                        behind = then
                        if ask == high:
                            ahead = then
                        if ask == low:
                            behind = hit
                        if alike and beside != NO_ENTRY:
                            # A ray that just misses the surface of both entries would be taken to meet it.
                            behind = beside
                            if joined(hit, beside, stage.targets.pieces):
                                behind = own
                        seen = seen_between(view, stage.targets, row, spot.d, ahead, behind, wholly)
                        if ask == low:
                            sure = True
                            if not joined(hit, seen, stage.targets.pieces):
                                if low == begun or waiting + 2 + halvings(low - begun) > MOST_PENDING:
                                    hit = seen
                                    if last >= 0:
                                        changes.after[last] = hit
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
                            place = room + take_place(count, band)
                        if place < room + most:
                            if last >= 0:
                                changes.following[last] = place
                            changes.job[place] = listed
                            changes.low[place] = low
                            changes.before[place] = hit
                            changes.after[place] = then
                            changes.following[place] = -1
                            last = place
                        low = high
                        hit = then
                        begun = high
                        sure = known
                        waiting -= 1
            if last < 0:
                # Step by step it is one surface after all.
                several.first[listed * cut.probes + n] = -1
                changes.begun[j] = cut.slots + 1
            j += workers

    return find_changes
