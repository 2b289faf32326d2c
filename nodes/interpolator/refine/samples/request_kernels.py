"""Holds the list of pixels at instants at which they are evaluated, and adds to it."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.image_kernels import pixel_type
from nodes.interpolator.refine.samples.list_kernels import ListPart, take_entry
from nodes.interpolator.refine.window_kernels import PixelInterval, WindowParameters, slot_row

wp.set_module_options({"enable_backward": False})

UNKNOWN = wp.constant(1.0e30)
"""Stands for a change of ln I that cannot be looked up in a keyframe."""
PAINTED = wp.constant(4.0e30)
"""The same, of what is followed by how finely it is painted: ln I goes up and down there, but never in a step."""
PARTS = wp.constant(64)
"""Parts of the time from one instant to the next."""
SHARP = wp.constant(2)
"""Half of the time that one surface takes to give way to the next, and light to be switched, in PARTS."""
FRAME_BEFORE = wp.constant(1)
FRAME_AFTER = wp.constant(2)
PREDICTED = wp.constant(3)
LIMB = wp.constant(4)
REPEATED = wp.constant(5)


@cache
def make_requests(channels: int) -> Any:
    """Makes the struct of a list of pixels at instants; channels: 1 (luminance) or 3 (RGB).

    at: index into [slots, E, h, w]. before, after: z-buffer entries at known instants before and after. previous: index
    in the list of the one before, of the same pixel and coarse interval, -1 = none. later: time of the sample after its
    instant, in PARTS, negative = before it. rise: change of ln I since the previous one, or since the coarse frame
    before, looked up in a keyframe, or UNKNOWN. ends: 1 for the last one of a coarse interval. tail: change of ln I
    from there to the coarse frame after. shown: of a sample that has the value of a coarse frame in place of its own,
    that before, FRAME_BEFORE, or after, FRAME_AFTER; 0 = its own, PREDICTED = that of which `rise` is the logarithm,
    LIMB = that of a point on the outline of the face in `after`, at these `weights` of its corners, REPEATED = that of
    the previous one.
    """
    pixel = pixel_type(channels)

    class Requests:
        at: wp.array(dtype=int)
        before: wp.array(dtype=wp.uint64)
        after: wp.array(dtype=wp.uint64)
        previous: wp.array(dtype=int)
        later: wp.array(dtype=int)
        rise: wp.array(dtype=pixel)
        ends: wp.array(dtype=int)
        tail: wp.array(dtype=pixel)
        shown: wp.array(dtype=int)
        weights: wp.array(dtype=wp.vec3)

    Requests.__qualname__ = f"Requests{channels}"
    return wp.struct(Requests)


@cache
def make_request(channels: int) -> Any:
    """Makes the function `request`; channels: 1 (luminance) or 3 (RGB)."""
    pixel = pixel_type(channels)
    Requests: Any = make_requests(channels)

    @wp.func
    def request(
        params: WindowParameters,
        requests: Requests,
        px: PixelInterval,
        i: int,
        before: wp.uint64,
        after: wp.uint64,
        rise: pixel,
        previous: int,
        out: ListPart,
    ):
        """Adds instant i of a pixel to a part of the list, as far as there is room. Gives its index."""
        n = take_entry(out)
        at = out.start + n
        if n < out.room:
            requests.at[at] = slot_row(params, 0, px.k, i) * params.height * params.width + px.q
            requests.before[at] = before
            requests.after[at] = after
            requests.previous[at] = previous
            requests.rise[at] = rise
            requests.ends[at] = 0
            requests.later[at] = 0
            requests.tail[at] = pixel(UNKNOWN)
            requests.shown[at] = 0
        return out.start + wp.min(n, out.room - 1)

    return request
