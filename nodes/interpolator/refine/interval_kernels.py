"""Decides which intervals between two samples of a pixel are halved, until ln I is straight between samples."""

from functools import cache
from typing import Any

import warp as wp

from evis.gpu.append_kernels import take_place
from nodes.interpolator.refine.evaluation.sight_kernels import make_seen_between
from nodes.interpolator.refine.paths.listing_kernels import (
    FRAME_AFTER,
    FRAME_BEFORE,
    PAINTED,
    PARTS,
    TOLD,
    UNKNOWN,
    make_instances,
)
from nodes.interpolator.refine.stage_kernels import (
    FEW_REGISTERS,
    Cut,
    Stage,
    entry_after,
    entry_before,
    frame_after,
    frame_before,
)
from nodes.interpolator.rigid.keyframe_kernels import log_of
from nodes.interpolator.rigid.look_up.log_kernels import apart, light
from nodes.interpolator.rigid.plan_kernels import joined
from nodes.renderer.raster.depth_kernels import NO_ENTRY
from nodes.renderer.raster.lens.view_kernels import CameraView, pixel_ray

wp.set_module_options({"enable_backward": False})

LENGTHS = wp.constant(1 << 15)
"""Greater than the number of instants of a coarse interval; packs two of them into one number."""
PAINTED_ENDS = wp.constant(1 << 30)
"""LENGTHS squared, which is added to that number where the interval is PAINTED."""


@cache
def make_intervals(channels: int) -> Any:
    """Makes the struct of a list of intervals; channels: 1 (luminance) or 3 (RGB).

    at: the instant at which the interval is halved and its pixel, index into [slots, E, h, w]. ends: LENGTHS times
    the instant of its start, counted within the coarse interval, plus that of its end, plus PAINTED_ENDS where it is
    painted, as of Interval. start, end: ln I at its ends. before, after: z-buffer entries there.
    """
    pixel: Any = wp.float32 if channels == 1 else wp.vec3

    class Intervals:
        at: wp.array(dtype=int)
        ends: wp.array(dtype=int)
        start: wp.array(dtype=pixel)
        end: wp.array(dtype=pixel)
        before: wp.array(dtype=wp.uint64)
        after: wp.array(dtype=wp.uint64)

    Intervals.__qualname__ = f"Intervals{channels}"
    return wp.struct(Intervals)


@cache
def make_interval(channels: int) -> Any:
    """Makes the struct of one interval; channels: 1 (luminance) or 3 (RGB).

    low, high: instants of its ends, counted within the coarse interval. first, last: ln I there. before, after:
    z-buffer entries there. rise: change of ln I looked up in a keyframe, or UNKNOWN or PAINTED. painted: whether it
    is PAINTED.
    """
    pixel: Any = wp.float32 if channels == 1 else wp.vec3

    class Interval:
        low: int
        high: int
        first: pixel
        last: pixel
        before: wp.uint64
        after: wp.uint64
        rise: pixel
        painted: wp.bool

    Interval.__qualname__ = f"Interval{channels}"
    return wp.struct(Interval)


seen_between = make_seen_between(False)
"""Without trees: that the few rays that meet nothing they should would be faster costs all others more."""


@wp.kernel(module="unique", enable_backward=False, cuda_max_registers=FEW_REGISTERS)
def see(
    # in
    view: CameraView,
    cut: Cut,
    workers: int,
    band: int,
    most: int,
    count: wp.array(dtype=int),
    stage: Stage,
    at: wp.array(dtype=int),
    before: wp.array(dtype=wp.uint64),
    after: wp.array(dtype=wp.uint64),
    # out
    hits: wp.array(dtype=wp.uint64),
):
    """Computes z-buffer entries of the listed pixels of a band; at, before, after: of Instances or of Intervals.

    NO_ENTRY, of what needs none, stays. A band's part of a list begins at band * most, and has count[band] entries, of
    which the first `most` are there.
    """
    first = band * most
    last = first + wp.min(count[band], most)
    j = first + wp.tid()
    while j < last:
        x = at[j] % cut.width + cut.margin
        y = at[j] // cut.width % cut.height + cut.margin
        n = at[j] // (cut.width * cut.height)
        if before[j] == NO_ENTRY:
            hits[j] = NO_ENTRY
        else:
            hits[j] = seen_between(view, stage.targets, n, pixel_ray(view, x, y), before[j], after[j], False)
        j += workers


@wp.func
def take_samples(made: wp.array(dtype=int), number: int, count: wp.array(dtype=int), most: int, band: int, thread: int):
    """Gives where the samples of a band's part of list `number` go; thread 0 notes where those of the next list do.

    made[number]: samples before this list. count, most: as of `see`.
    """
    known = made[number]
    following = known
    for k in range(count.shape[0]):
        mine = wp.min(count[k], most)
        if k < band:
            known += mine
        following += mine
    if thread == 0:
        made[number + 1] = following
    return known


@cache
def make_put(channels: int) -> Any:
    """Makes the function `put`; channels: 1 (luminance) or 3 (RGB)."""
    Intervals: Any = make_intervals(channels)
    Interval: Any = make_interval(channels)

    @wp.func
    def put(
        cut: Cut,
        intervals: Intervals,
        band: int,
        room: int,
        at: int,
        one: Interval,
        found: wp.array(dtype=int),
    ):
        """Lists an interval, as far as there is room. at: its pixel at any slot of the coarse interval."""
        n = take_place(found, band)
        if n < room:
            place = band * room + n
            inner = cut.envs * cut.height * cut.width
            k = at // inner // cut.slots
            intervals.at[place] = (k * cut.slots + (one.low + one.high) // 2 - 1) * inner + at % inner
            intervals.ends[place] = one.low * LENGTHS + one.high + wp.where(one.painted, PAINTED_ENDS, 0)
            intervals.start[place] = one.first
            intervals.end[place] = one.last
            intervals.before[place] = one.before
            intervals.after[place] = one.after

    return put


@cache
def make_check(channels: int) -> wp.Kernel:
    """Makes the kernel `check`, which follows the first list of samples; channels: 1 (luminance) or 3 (RGB)."""
    pixel: Any = wp.float32 if channels == 1 else wp.vec3
    Intervals: Any = make_intervals(channels)
    Interval: Any = make_interval(channels)
    Instances: Any = make_instances(channels)
    put = make_put(channels)

    @wp.func
    def is_painted(rise: pixel):
        """Tells whether a rise is PAINTED."""
        return apart(rise, pixel(0.0)) >= PAINTED

    @wp.func
    def one_surface(stage: Stage, one: Interval):
        """Tells whether an interval has an instant in it, and shows one surface at both ends."""
        return one.high - one.low > 1 and joined(one.before, one.after, stage.targets.pieces)

    @wp.func
    def suspect(cut: Cut, stage: Stage, one: Interval):
        """Tells whether in an interval of one surface ln I has changed otherwise than looked up in a keyframe."""
        if not one_surface(stage, one):
            return False
        actual = one.last - one.first
        if apart(one.rise, pixel(0.0)) >= UNKNOWN:
            return apart(actual, pixel(0.0)) > cut.jump
        return apart(one.rise, actual) > cut.bend

    @wp.func
    def value_of(
        cut: Cut,
        j: int,
        image: wp.array3d(dtype=pixel),
        frames: wp.array3d(dtype=pixel),
        instances: Instances,
        radiance: wp.array(dtype=pixel),
    ):
        """Gives the light of entry j of a list."""
        inner = cut.envs * cut.height * cut.width
        k = cut.first + instances.at[j] // inner // cut.slots
        q = instances.at[j] % inner
        x = q % cut.width
        y = q // cut.width % cut.height
        env = q // (cut.width * cut.height)
        value = radiance[j]
        if instances.shown[j] == FRAME_AFTER:
            value = frame_after(cut, frames, env, k, y, x)
        elif instances.shown[j] == FRAME_BEFORE:
            value = frame_before(cut, image, frames, env, k, y, x)
        elif instances.shown[j] == TOLD:
            value = light(instances.rise[j])
        return value

    @wp.func
    def interval_to(
        cut: Cut,
        j: int,
        image: wp.array3d(dtype=pixel),
        start: wp.array3d(dtype=wp.uint64),
        frames: wp.array3d(dtype=pixel),
        stage: Stage,
        instances: Instances,
        hits: wp.array(dtype=wp.uint64),
        radiance: wp.array(dtype=pixel),
    ):
        """Gives the interval that ends with entry j of a list: from the entry before it, or the coarse frame."""
        inner = cut.envs * cut.height * cut.width
        slot = instances.at[j] // inner
        q = instances.at[j] % inner
        k = cut.first + slot // cut.slots
        x = q % cut.width
        y = q // cut.width % cut.height
        env = q // (cut.width * cut.height)
        p = instances.previous[j]
        one = Interval()
        one.high = slot % cut.slots + 1
        one.last = log_of(value_of(cut, j, image, frames, instances, radiance))
        one.after = hits[j]
        one.rise = instances.rise[j]
        one.painted = is_painted(one.rise)
        if p >= 0:
            one.low = instances.at[p] // inner % cut.slots + 1
            one.first = log_of(radiance[p])
            one.before = hits[p]
        else:
            one.first = log_of(frame_before(cut, image, frames, env, k, y, x))
            one.before = entry_before(cut, stage, start, env, k, y, x)
        return one

    @wp.func
    def interval_after(
        cut: Cut,
        j: int,
        value: pixel,
        frames: wp.array3d(dtype=pixel),
        stage: Stage,
        instances: Instances,
        hits: wp.array(dtype=wp.uint64),
    ):
        """Gives the interval from entry j of a list, where ln I is `value`, to the coarse frame after it; an empty one
        where another entry follows."""
        one = Interval()
        if instances.ends[j] == 1:
            inner = cut.envs * cut.height * cut.width
            slot = instances.at[j] // inner
            q = instances.at[j] % inner
            k = cut.first + slot // cut.slots
            x = q % cut.width
            y = q // cut.width % cut.height
            env = q // (cut.width * cut.height)
            one.low = slot % cut.slots + 1
            one.high = cut.slots + 1
            one.first = value
            one.last = log_of(frame_after(cut, frames, env, k, y, x))
            one.before = hits[j]
            one.after = entry_after(cut, stage, env, k, y, x)
            one.rise = instances.tail[j]
            one.painted = is_painted(one.rise)
        return one

    @wp.kernel(module="unique", enable_backward=False)
    def check(
        # in
        cut: Cut,
        workers: int,
        band: int,
        most: int,
        number: int,
        count: wp.array(dtype=int),
        room: int,
        image: wp.array3d(dtype=pixel),
        start: wp.array3d(dtype=wp.uint64),
        frames: wp.array3d(dtype=pixel),
        stage: Stage,
        instances: Instances,
        hits: wp.array(dtype=wp.uint64),
        radiance: wp.array(dtype=pixel),
        # in and out
        made: wp.array(dtype=int),
        # out
        pixels: wp.array(dtype=int),
        instants: wp.array(dtype=int),
        values: wp.array(dtype=pixel),
        intervals: Intervals,
        found: wp.array(dtype=int),
    ):
        """Adds a band's entries of `instances` to the samples, as far as there is room, and lists the intervals beside
        them that are to be halved, from band * room on, `room` at most; found[band]: how many there would be.

        band, most, count: as of `see`. number, made: as of `take_samples`. image, start, frames: as of `find_plain`.
        """
        first = band * most
        last = first + wp.min(count[band], most)
        known = take_samples(made, number, count, most, band, wp.tid())
        j = first + wp.tid()
        inner = cut.envs * cut.height * cut.width
        while j < last:
            at = instances.at[j]
            slot = at // inner
            q = at % inner
            k = cut.first + slot // cut.slots
            place = slot % cut.slots + 1
            value = value_of(cut, j, image, frames, instances, radiance)
            sample = known + j - first
            if sample < pixels.shape[0]:
                pixels[sample] = q
                instants[sample] = (k * (cut.slots + 1) + place) * PARTS + instances.later[j]
                values[sample] = value
            # What is told is on straight lines already, for a pixel's whole coarse interval.
            if instances.shown[j] != TOLD:
                here = interval_to(cut, j, image, start, frames, stage, instances, hits, radiance)
                after = interval_after(cut, j, here.last, frames, stage, instances, hits)
                wrong = suspect(cut, stage, here)
                wrong_before = wp.bool(False)
                wrong_after = suspect(cut, stage, after)
                p = instances.previous[j]
                if p >= 0:
                    if here.painted or is_painted(instances.rise[p]):
                        there = interval_to(cut, p, image, start, frames, stage, instances, hits, radiance)
                        wrong_before = suspect(cut, stage, there)
                        if wrong and not wrong_before and there.painted and one_surface(stage, there):
                            # Where what lies before that is suspect, entry p has listed it.
                            listed = wp.bool(False)
                            if instances.previous[p] >= 0:
                                pp = instances.previous[p]
                                before = interval_to(cut, pp, image, start, frames, stage, instances, hits, radiance)
                                listed = suspect(cut, stage, before)
                            if not listed:
                                put(cut, intervals, band, room, at, there, found)
                if wrong or (here.painted and (wrong_before or wrong_after) and one_surface(stage, here)):
                    put(cut, intervals, band, room, at, here, found)
                if wrong_after or (after.painted and wrong and one_surface(stage, after)):
                    put(cut, intervals, band, room, at, after, found)
            j += workers

    return check


@cache
def make_split(channels: int) -> wp.Kernel:
    """Makes the kernel `split`, which follows later lists; channels: 1 (luminance) or 3 (RGB)."""
    pixel: Any = wp.float32 if channels == 1 else wp.vec3
    Intervals: Any = make_intervals(channels)
    Interval: Any = make_interval(channels)
    put = make_put(channels)

    @wp.kernel(module="unique", enable_backward=False)
    def split(
        # in
        cut: Cut,
        workers: int,
        band: int,
        most: int,
        number: int,
        count: wp.array(dtype=int),
        room: int,
        pieces: wp.array(dtype=wp.vec2i),
        intervals: Intervals,
        hits: wp.array(dtype=wp.uint64),
        radiance: wp.array(dtype=pixel),
        # in and out
        made: wp.array(dtype=int),
        # out
        pixels: wp.array(dtype=int),
        instants: wp.array(dtype=int),
        values: wp.array(dtype=pixel),
        halves: Intervals,
        found: wp.array(dtype=int),
    ):
        """Adds the middles of a band's intervals to the samples, and lists those of their halves that are to be halved
        again; arguments as of `check`."""
        first = band * most
        last = first + wp.min(count[band], most)
        known = take_samples(made, number, count, most, band, wp.tid())
        j = first + wp.tid()
        inner = cut.envs * cut.height * cut.width
        while j < last:
            at = intervals.at[j]
            slot = at // inner
            middle = radiance[j]
            place = slot % cut.slots + 1
            sample = known + j - first
            if sample < pixels.shape[0]:
                pixels[sample] = at % inner
                instants[sample] = ((cut.first + slot // cut.slots) * (cut.slots + 1) + place) * PARTS
                values[sample] = middle
            painted = intervals.ends[j] >= PAINTED_ENDS
            low = intervals.ends[j] % PAINTED_ENDS // LENGTHS
            high = intervals.ends[j] % LENGTHS
            log_a = intervals.start[j]
            log_b = intervals.end[j]
            log_m = log_of(middle)
            share = float(place - low) / float(high - low)
            bent = apart(log_m, log_a + share * (log_b - log_a)) > cut.bend
            for side in range(2):
                start = wp.where(side == 0, low, place)
                end = wp.where(side == 0, place, high)
                ahead = intervals.before[j]
                behind = hits[j]
                from_here = log_a
                to_there = log_m
                if side == 1:
                    ahead = behind
                    behind = intervals.after[j]
                    from_here = log_m
                    to_there = log_b
                if end > start + 1:
                    # Before and behind a peak what is painted has the same light.
                    taken = bent and (painted or apart(from_here, to_there) > cut.jump)
                    if taken or not joined(ahead, behind, pieces):
                        half = Interval()
                        half.low = start
                        half.high = end
                        half.first = from_here
                        half.last = to_there
                        half.before = ahead
                        half.after = behind
                        half.painted = painted
                        put(cut, halves, band, room, at, half, found)
            j += workers

    return split
