"""Reserves places for events by one atomic addition per pixel, instead of one for all pixels of a warp."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func
def take_room_alone(counters: wp.array(dtype=wp.int64), place: wp.int32, n: wp.int32):
    """Reserves places for n events by one atomic addition per pixel and step; returns the first place."""
    return wp.atomic_add(counters, place, wp.int64(n))
