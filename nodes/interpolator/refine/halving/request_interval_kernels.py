"""Gives the intervals beside a sample of the first list: to the one before, and to the coarse frame after the last."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.refine.halving.interval_kernels import make_interval
from nodes.interpolator.refine.samples.request_kernels import FRAME_AFTER, FRAME_BEFORE, PAINTED, TOLD, make_instances
from nodes.interpolator.refine.window_kernels import Cut, Stage, entry_after, entry_before, frame_after, frame_before
from nodes.interpolator.rigid.keyframe_kernels import log_of
from nodes.interpolator.rigid.look_up.log_kernels import apart, light
from nodes.renderer.raster.depth_kernels import MISS, triangle_of

wp.set_module_options({"enable_backward": False})


@cache
def make_is_painted(channels: int, glossy: bool) -> Any:
    """Makes the function `is_painted`; arguments as of make_beside."""
    pixel: Any = wp.float32 if channels == 1 else wp.vec3

    @wp.func
    def is_painted(stage: Stage, rise: pixel, hit: wp.uint64):
        """Tells whether light goes up and down in an interval that ends with a z-buffer entry, and never in a step:
        the rise is PAINTED, or a highlight may pass."""
        if wp.static(glossy):
            t = triangle_of(hit)
            if t != MISS:
                if stage.alpha[stage.targets.instance[t]] >= 0.0:
                    return True
        return apart(rise, pixel(0.0)) >= PAINTED

    return is_painted


@cache
def make_beside(channels: int, glossy: bool) -> tuple[Any, Any, Any]:
    """Makes the functions `value_of`, `interval_to` and `interval_after`.

    channels: 1 (luminance) or 3 (RGB). glossy: whether highlights may pass over surfaces.
    """
    pixel: Any = wp.float32 if channels == 1 else wp.vec3
    Interval: Any = make_interval(channels)
    Instances: Any = make_instances(channels)
    is_painted = make_is_painted(channels, glossy)

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
        one.painted = is_painted(stage, one.rise, one.after)
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
            one.painted = is_painted(stage, one.rise, one.before)
        return one

    return value_of, interval_to, interval_after
