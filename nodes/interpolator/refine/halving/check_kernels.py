"""Finds the intervals beside the first samples of a pixel in which ln I is not as looked up in a keyframe."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.image_kernels import pixel_type
from nodes.interpolator.refine.halving.interval_kernels import (
    make_add_interval,
    make_interval,
    make_intervals,
    make_leaps,
    take_samples,
)
from nodes.interpolator.refine.halving.request_interval_kernels import make_is_painted, make_request_intervals
from nodes.interpolator.refine.samples.list_kernels import ListPart, end_of, make_add_sample, make_sample_list
from nodes.interpolator.refine.samples.request_kernels import LIMB, PARTS, PREDICTED, UNKNOWN, make_requests
from nodes.interpolator.refine.window_kernels import (
    FEW_REGISTERS,
    WindowParameters,
    WindowScene,
    make_coarse_frames,
    slot_pixel_of,
)
from nodes.interpolator.rigid.look_up.log_kernels import apart
from nodes.interpolator.rigid.plan_kernels import same_surface

wp.set_module_options({"enable_backward": False})


@cache
def make_check(channels: int, glossy: bool) -> wp.Kernel:
    """Makes the kernel `check`, which follows the first list of samples; arguments as of make_request_intervals."""
    pixel = pixel_type(channels)
    Intervals: Any = make_intervals(channels)
    Interval: Any = make_interval(channels)
    Requests: Any = make_requests(channels)
    CoarseFrames: Any = make_coarse_frames(channels)
    SampleList: Any = make_sample_list(channels)
    add_sample = make_add_sample(channels)
    add_interval, is_painted = make_add_interval(channels), make_is_painted(channels, glossy)
    value_of, interval_before, interval_after = make_request_intervals(channels, glossy)
    leaps, turns_back = make_leaps(channels)

    @wp.func
    def one_surface(scene: WindowScene, one: Interval):
        """Tells whether an interval has an instant in it, and shows one surface at both ends."""
        return one.high - one.low > 1 and same_surface(one.before, one.after, scene.targets.pieces)

    @wp.func
    def suspect(params: WindowParameters, scene: WindowScene, one: Interval):
        """Tells whether in an interval of one surface ln I has changed otherwise than looked up in a keyframe."""
        if not one_surface(scene, one):
            return False
        actual = one.last - one.first
        if apart(one.rise, pixel(0.0)) >= UNKNOWN:
            return apart(actual, pixel(0.0)) > params.jump
        return apart(one.rise, actual) > params.bend

    @wp.kernel(module="unique", enable_backward=False, cuda_max_registers=FEW_REGISTERS)
    def check(
        # in
        params: WindowParameters,
        workers: int,
        number: int,
        scene: WindowScene,
        coarse: CoarseFrames,
        swung: wp.array(dtype=int),
        requests: Requests,
        part: ListPart,
        hits: wp.array(dtype=wp.uint64),
        radiance: wp.array(dtype=pixel),
        # in and out
        samples: SampleList,
        # out
        intervals: Intervals,
        out: ListPart,
    ):
        """Adds a part of the requests to the samples, as far as there is room, and lists the intervals beside them that
        are to be halved.

        swung [E]: to which `swings` of Tally are added. number: of the list of requests, as of `take_samples`. hits,
        radiance: what was found of each entry.
        """
        known = take_samples(samples.made, number, part, wp.tid())
        j = part.start + wp.tid()
        while j < end_of(part):
            at = requests.at[j]
            place = slot_pixel_of(params, at)
            value = value_of(params, j, coarse, requests, radiance)
            instant = (place.k * (params.slots + 1) + place.i) * PARTS + requests.later[j]
            add_sample(samples, known + j - part.start, place.q, instant, value)
            # What is told is on straight lines already, for a pixel's whole coarse interval.
            # Beside an outline light is where it is between two instants.
            if requests.shown[j] != PREDICTED and requests.shown[j] != LIMB:
                here = interval_before(params, j, coarse, scene, requests, hits, radiance)
                after = interval_after(params, j, here.last, coarse, scene, requests, hits)
                wrong = suspect(params, scene, here)
                wrong_before = wp.bool(False)
                wrong_after = suspect(params, scene, after)
                p = requests.previous[j]
                if p >= 0:
                    leap = leaps(params, scene, here)
                    if leap or here.painted or is_painted(scene, requests.rise[p], hits[p]):
                        there = interval_before(params, p, coarse, scene, requests, hits, radiance)
                        if leap and leaps(params, scene, there) and turns_back(there, here):
                            wp.atomic_add(swung, place.env, 1)
                        wrong_before = suspect(params, scene, there)
                        if wrong and not wrong_before and there.painted and one_surface(scene, there):
                            # Where what lies before that is suspect, entry p has listed it.
                            listed = wp.bool(False)
                            if requests.previous[p] >= 0:
                                pp = requests.previous[p]
                                before = interval_before(params, pp, coarse, scene, requests, hits, radiance)
                                listed = suspect(params, scene, before)
                            if not listed:
                                add_interval(params, intervals, at, there, out)
                if wrong or (here.painted and (wrong_before or wrong_after) and one_surface(scene, here)):
                    add_interval(params, intervals, at, here, out)
                if wrong_after or (after.painted and wrong and one_surface(scene, after)):
                    add_interval(params, intervals, at, after, out)
            j += workers

    return check
