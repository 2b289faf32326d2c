"""Gives the intervals beside a sample of the first list: to the one before, and to the coarse frame after the last."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.image_kernels import pixel_type
from nodes.interpolator.refine.halving.interval_kernels import make_interval
from nodes.interpolator.refine.samples.request_kernels import (
    FRAME_AFTER,
    FRAME_BEFORE,
    PAINTED,
    PREDICTED,
    REPEATED,
    make_requests,
)
from nodes.interpolator.refine.window_kernels import (
    WindowParameters,
    WindowScene,
    entry_after,
    entry_before,
    frame_after,
    frame_before,
    instant_of,
    make_coarse_frames,
    slot_pixel_of,
)
from nodes.interpolator.rigid.keyframe_kernels import log_of
from nodes.interpolator.rigid.look_up.log_kernels import apart, light
from nodes.renderer.raster.depth_kernels import MISS, triangle_of

wp.set_module_options({"enable_backward": False})


@cache
def make_is_painted(channels: int, glossy: bool) -> Any:
    """Makes the function `is_painted`; arguments as of make_request_intervals."""
    pixel = pixel_type(channels)

    @wp.func
    def is_painted(scene: WindowScene, rise: pixel, hit: wp.uint64):
        """Tells whether light goes up and down in an interval that ends with a z-buffer entry, and never in a step:
        the rise is PAINTED, or a highlight may pass."""
        if wp.static(glossy):
            t = triangle_of(hit)
            if t != MISS:
                if scene.alpha[scene.targets.instance[t]] >= 0.0:
                    return True
        return apart(rise, pixel(0.0)) >= PAINTED

    return is_painted


@cache
def make_request_intervals(channels: int, glossy: bool) -> tuple[Any, Any, Any]:
    """Makes the functions `value_of`, `interval_before` and `interval_after`.

    channels: 1 (luminance) or 3 (RGB). glossy: whether highlights may pass over surfaces.
    """
    pixel = pixel_type(channels)
    Interval: Any = make_interval(channels)
    Requests: Any = make_requests(channels)
    CoarseFrames: Any = make_coarse_frames(channels)
    is_painted = make_is_painted(channels, glossy)

    @wp.func
    def value_of(
        params: WindowParameters,
        j: int,
        coarse: CoarseFrames,
        requests: Requests,
        radiance: wp.array(dtype=pixel),
    ):
        """Gives the light of entry j of a list."""
        at = slot_pixel_of(params, requests.at[j])
        value = radiance[j]
        if requests.shown[j] == FRAME_AFTER:
            value = frame_after(params, coarse, at.env, at.k, at.y, at.x)
        elif requests.shown[j] == FRAME_BEFORE:
            value = frame_before(params, coarse, at.env, at.k, at.y, at.x)
        elif requests.shown[j] == PREDICTED:
            value = light(requests.rise[j])
        elif requests.shown[j] == REPEATED:
            value = radiance[requests.previous[j]]
        return value

    @wp.func
    def interval_before(
        params: WindowParameters,
        j: int,
        coarse: CoarseFrames,
        scene: WindowScene,
        requests: Requests,
        hits: wp.array(dtype=wp.uint64),
        radiance: wp.array(dtype=pixel),
    ):
        """Gives the interval that ends with entry j of a list: from the entry before it, or the coarse frame."""
        at = slot_pixel_of(params, requests.at[j])
        p = requests.previous[j]
        one = Interval()
        one.high = at.i
        one.last = log_of(value_of(params, j, coarse, requests, radiance))
        one.after = hits[j]
        one.rise = requests.rise[j]
        one.painted = is_painted(scene, one.rise, one.after)
        if p >= 0:
            one.low = instant_of(params, requests.at[p])
            one.first = log_of(radiance[p])
            one.before = hits[p]
        else:
            one.first = log_of(frame_before(params, coarse, at.env, at.k, at.y, at.x))
            one.before = entry_before(params, scene, at.env, at.k, at.y, at.x)
        return one

    @wp.func
    def interval_after(
        params: WindowParameters,
        j: int,
        value: pixel,
        coarse: CoarseFrames,
        scene: WindowScene,
        requests: Requests,
        hits: wp.array(dtype=wp.uint64),
    ):
        """Gives the interval from entry j of a list, where ln I is `value`, to the coarse frame after it; an empty one
        where another entry follows."""
        one = Interval()
        if requests.ends[j] == 1:
            at = slot_pixel_of(params, requests.at[j])
            one.low = at.i
            one.high = params.slots + 1
            one.first = value
            one.last = log_of(frame_after(params, coarse, at.env, at.k, at.y, at.x))
            one.before = hits[j]
            one.after = entry_after(params, scene, at.env, at.k, at.y, at.x)
            one.rise = requests.tail[j]
            one.painted = is_painted(scene, one.rise, one.before)
        return one

    return value_of, interval_before, interval_after
