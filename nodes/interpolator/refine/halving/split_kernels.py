"""Halves intervals, and finds the halves in which ln I is still not straight."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.refine.halving.interval_kernels import (
    LENGTHS,
    PAINTED_ENDS,
    make_add_interval,
    make_interval,
    make_intervals,
    take_samples,
)
from nodes.interpolator.refine.samples.list_kernels import ListPart, end_of, make_add_sample, make_sample_list
from nodes.interpolator.refine.samples.request_kernels import PARTS
from nodes.interpolator.refine.window_kernels import WindowParameters, slot_pixel_of
from nodes.interpolator.rigid.keyframe_kernels import log_of
from nodes.interpolator.rigid.look_up.log_kernels import apart
from nodes.interpolator.rigid.plan_kernels import same_surface

wp.set_module_options({"enable_backward": False})


@cache
def make_split(channels: int) -> wp.Kernel:
    """Makes the kernel `split`, which follows later lists; channels: 1 (luminance) or 3 (RGB)."""
    pixel: Any = wp.float32 if channels == 1 else wp.vec3
    Intervals: Any = make_intervals(channels)
    Interval: Any = make_interval(channels)
    SampleList: Any = make_sample_list(channels)
    add_interval, add_sample = make_add_interval(channels), make_add_sample(channels)

    @wp.kernel(module="unique", enable_backward=False)
    def split(
        # in
        params: WindowParameters,
        workers: int,
        number: int,
        pieces: wp.array(dtype=wp.vec2i),
        intervals: Intervals,
        part: ListPart,
        hits: wp.array(dtype=wp.uint64),
        radiance: wp.array(dtype=pixel),
        # in and out
        samples: SampleList,
        # out
        halves: Intervals,
        out: ListPart,
    ):
        """Adds the middles of a part of the intervals to the samples, and lists those of their halves that are to be
        halved again; arguments as of `check`."""
        known = take_samples(samples.made, number, part, wp.tid())
        j = part.start + wp.tid()
        while j < end_of(part):
            at = intervals.at[j]
            place = slot_pixel_of(params, at)
            middle = radiance[j]
            instant = (place.k * (params.slots + 1) + place.i) * PARTS
            add_sample(samples, known + j - part.start, place.q, instant, middle)
            painted = intervals.ends[j] >= PAINTED_ENDS
            low = intervals.ends[j] % PAINTED_ENDS // LENGTHS
            high = intervals.ends[j] % LENGTHS
            log_a = intervals.start[j]
            log_b = intervals.end[j]
            log_m = log_of(middle)
            share = float(place.i - low) / float(high - low)
            bent = apart(log_m, log_a + share * (log_b - log_a)) > params.bend
            for side in range(2):
                start = wp.where(side == 0, low, place.i)
                end = wp.where(side == 0, place.i, high)
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
                    # Before and behind a peak what is painted, or glossy, has the same light.
                    taken = bent and (painted or apart(from_here, to_there) > params.jump)
                    if taken or not same_surface(ahead, behind, pieces):
                        half = Interval()
                        half.low = start
                        half.high = end
                        half.first = from_here
                        half.last = to_there
                        half.before = ahead
                        half.after = behind
                        half.painted = painted
                        add_interval(params, halves, at, half, out)
            j += workers

    return split
