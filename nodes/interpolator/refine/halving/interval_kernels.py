"""Holds the list of intervals between two samples of a pixel that are to be halved, and adds to it."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.image_kernels import pixel_type
from nodes.interpolator.refine.samples.list_kernels import ListPart, take_entry
from nodes.interpolator.refine.window_kernels import WindowParameters, WindowScene
from nodes.interpolator.rigid.look_up.log_kernels import apart
from nodes.interpolator.rigid.plan_kernels import same_surface
from nodes.renderer.raster.depth_kernels import MISS, depth_of, triangle_of

wp.set_module_options({"enable_backward": False})

LENGTHS = wp.constant(1 << 15)
"""Greater than the number of instants of a coarse interval; packs two of them into one number."""
PAINTED_ENDS = wp.constant(1 << 30)
"""LENGTHS squared, which is added to that number where the interval is PAINTED."""
FINE = wp.constant(3.0)
"""Length [px] over which a texture goes up or down from which on it stays as it is from one sample to the next."""


@cache
def make_intervals(channels: int) -> Any:
    """Makes the struct of a list of intervals; channels: 1 (luminance) or 3 (RGB).

    at: the instant at which the interval is halved and its pixel, index into [slots, E, h, w]. ends: LENGTHS times
    the instant of its start, counted within the coarse interval, plus that of its end, plus PAINTED_ENDS where it is
    painted, as of Interval. start, end: ln I at its ends. before, after: z-buffer entries there.
    """
    pixel = pixel_type(channels)

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
    pixel = pixel_type(channels)

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


@cache
def make_add_interval(channels: int) -> Any:
    """Makes the function `add_interval`; channels: 1 (luminance) or 3 (RGB)."""
    Intervals: Any = make_intervals(channels)
    Interval: Any = make_interval(channels)

    @wp.func
    def add_interval(
        params: WindowParameters,
        intervals: Intervals,
        at: int,
        one: Interval,
        out: ListPart,
    ):
        """Lists an interval, as far as there is room. at: its pixel at any slot of the coarse interval."""
        n = take_entry(out)
        if n < out.room:
            place = out.start + n
            inner = params.envs * params.height * params.width
            k = at // inner // params.slots
            intervals.at[place] = (k * params.slots + (one.low + one.high) // 2 - 1) * inner + at % inner
            intervals.ends[place] = one.low * LENGTHS + one.high + wp.where(one.painted, PAINTED_ENDS, 0)
            intervals.start[place] = one.first
            intervals.end[place] = one.last
            intervals.before[place] = one.before
            intervals.after[place] = one.after

    return add_interval


@cache
def make_leaps(channels: int) -> tuple[Any, Any]:
    """Makes the functions `leaps` and `turns_back`; channels: 1 (luminance) or 3 (RGB)."""
    Interval: Any = make_interval(channels)

    @wp.func
    def leaps(params: WindowParameters, scene: WindowScene, one: Interval):
        """Tells whether ln I goes far in an interval with no instant in it, over one surface that is painted so finely
        that samples beside a peak tell little of it."""
        if one.high - one.low > 1 or apart(one.last, one.first) < params.rough:
            return False
        t = triangle_of(one.after)
        if t == MISS or not same_surface(one.before, one.after, scene.targets.pieces):
            return False
        return scene.targets.albedo_scale[t] * params.gain < FINE * depth_of(one.after)

    @wp.func
    def turns_back(there: Interval, here: Interval):
        """Tells whether ln I goes less far in two intervals in a row than in one of them."""
        whole = apart(here.last, there.first)
        return whole < apart(there.last, there.first) or whole < apart(here.last, here.first)

    return leaps, turns_back


@wp.func
def take_samples(made: wp.array(dtype=int), number: int, listed: ListPart, thread: int):
    """Gives where the samples of a band's part of list `number` go; thread 0 notes where those of the next list do.

    made[number]: samples before this list, whose bands have room for as many entries each.
    """
    known = made[number]
    following = known
    for k in range(listed.count.shape[0]):
        mine = wp.min(listed.count[k], listed.room)
        if k < listed.band:
            known += mine
        following += mine
    if thread == 0:
        made[number + 1] = following
    return known
