"""Finds the intervals beside the first samples of a pixel in which ln I is not as looked up in a keyframe."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.refine.halving.interval_kernels import make_interval, make_intervals, make_put, take_samples
from nodes.interpolator.refine.halving.request_interval_kernels import make_beside, make_is_painted
from nodes.interpolator.refine.samples.request_kernels import PARTS, TOLD, UNKNOWN, make_instances
from nodes.interpolator.refine.window_kernels import FEW_REGISTERS, Cut, Stage
from nodes.interpolator.rigid.look_up.log_kernels import apart
from nodes.interpolator.rigid.plan_kernels import joined

wp.set_module_options({"enable_backward": False})


@cache
def make_check(channels: int, glossy: bool) -> wp.Kernel:
    """Makes the kernel `check`, which follows the first list of samples; arguments as of make_beside."""
    pixel: Any = wp.float32 if channels == 1 else wp.vec3
    Intervals: Any = make_intervals(channels)
    Interval: Any = make_interval(channels)
    Instances: Any = make_instances(channels)
    put, is_painted = make_put(channels), make_is_painted(channels, glossy)
    value_of, interval_to, interval_after = make_beside(channels, glossy)

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

    @wp.kernel(module="unique", enable_backward=False, cuda_max_registers=FEW_REGISTERS)
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
                    if here.painted or is_painted(stage, instances.rise[p], hits[p]):
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
