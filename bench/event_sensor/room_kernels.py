"""Takes room for events as a GPU sensor would without adding up what a warp needs."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func
def take_room_alone(counters: wp.array(dtype=wp.int64), place: wp.int32, n: wp.int32):
    """Takes room for events by one atomic per pixel and step."""
    return wp.atomic_add(counters, place, wp.int64(n))
