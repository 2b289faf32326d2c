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
from nodes.interpolator.refine.samples.request_kernels import PARTS
from nodes.interpolator.refine.window_kernels import WindowParameters
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
    add_interval = make_add_interval(channels)

    @wp.kernel(module="unique", enable_backward=False)
    def split(
        # in
        params: WindowParameters,
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
        inner = params.envs * params.height * params.width
        while j < last:
            at = intervals.at[j]
            slot = at // inner
            middle = radiance[j]
            place = slot % params.slots + 1
            sample = known + j - first
            if sample < pixels.shape[0]:
                pixels[sample] = at % inner
                instants[sample] = ((params.first + slot // params.slots) * (params.slots + 1) + place) * PARTS
                values[sample] = middle
            painted = intervals.ends[j] >= PAINTED_ENDS
            low = intervals.ends[j] % PAINTED_ENDS // LENGTHS
            high = intervals.ends[j] % LENGTHS
            log_a = intervals.start[j]
            log_b = intervals.end[j]
            log_m = log_of(middle)
            share = float(place - low) / float(high - low)
            bent = apart(log_m, log_a + share * (log_b - log_a)) > params.bend
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
                        add_interval(params, halves, band, room, at, half, found)
            j += workers

    return split
