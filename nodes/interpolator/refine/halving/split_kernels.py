"""Halves intervals, and finds the halves in which ln I is still not straight."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.image_kernels import pixel_type
from nodes.interpolator.refine.halving.interval_kernels import (
    LENGTHS,
    PAINTED_ENDS,
    make_add_interval,
    make_interval,
    make_intervals,
    make_leaps,
    take_samples,
)
from nodes.interpolator.refine.samples.list_kernels import ListPart, end_of, make_add_sample, make_sample_list
from nodes.interpolator.refine.samples.request_kernels import PARTS
from nodes.interpolator.refine.window_kernels import WindowParameters, WindowScene, slot_pixel_of
from nodes.interpolator.rigid.keyframe_kernels import log_of
from nodes.interpolator.rigid.look_up.log_kernels import apart
from nodes.interpolator.rigid.plan_kernels import same_surface

wp.set_module_options({"enable_backward": False})


@cache
def make_split(channels: int) -> wp.Kernel:
    """Makes the kernel `split`, which follows later lists; channels: 1 (luminance) or 3 (RGB)."""
    pixel = pixel_type(channels)
    Intervals: Any = make_intervals(channels)
    Interval: Any = make_interval(channels)
    SampleList: Any = make_sample_list(channels)
    add_interval, add_sample = make_add_interval(channels), make_add_sample(channels)
    leaps, turns_back = make_leaps(channels)

    @wp.kernel(module="unique", enable_backward=False)
    def split(
        # in
        params: WindowParameters,
        workers: int,
        number: int,
        scene: WindowScene,
        swung: wp.array(dtype=int),
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
            there = Interval()
            there.low = low
            there.high = place.i
            there.first = log_a
            there.last = log_m
            there.before = intervals.before[j]
            there.after = hits[j]
            there.painted = painted
            here = Interval()
            here.low = place.i
            here.high = high
            here.first = log_m
            here.last = log_b
            here.before = hits[j]
            here.after = intervals.after[j]
            here.painted = painted
            if bent and leaps(params, scene, there) and leaps(params, scene, here) and turns_back(there, here):
                wp.atomic_add(swung, place.env, 1)
            for side in range(2):
                half = there
                if side == 1:
                    half = here
                if half.high > half.low + 1:
                    # Before and behind a peak what is painted, or glossy, has the same light.
                    taken = bent and (painted or apart(half.first, half.last) > params.jump)
                    if taken or not same_surface(half.before, half.after, scene.targets.pieces):
                        add_interval(params, halves, at, half, out)
            j += workers

    return split
