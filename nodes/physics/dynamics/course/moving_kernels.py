"""Finds which bodies move in an interval, on a CPU."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func
def moves_at(pose: wp.array(dtype=wp.int64), last: wp.array(dtype=wp.int64), twist: wp.array(dtype=wp.int64)):
    """Tells whether a body is elsewhere than at last, or has a velocity."""
    for k in range(7):
        if pose[k] != last[k]:
            return True
    for k in range(6):
        if twist[k] != wp.int64(0):
            return True
    return False


@wp.kernel
def find_moving(
    # in
    start: int,
    poses: wp.array4d(dtype=wp.int64),
    twists: wp.array4d(dtype=wp.int64),
    # out
    moving: wp.array2d(dtype=int),
):
    """Tells of each environment from `start` on which of its bodies are not at one pose without velocity throughout, to
    the bit, as `msgs.world.moves` does.

    poses [E, S, M, 7] and twists [E, S, M, 6], the bits of their float64. moving: [E, M], 0 or 1.
    """
    e = start + wp.tid()
    steps = poses.shape[1]
    for m in range(poses.shape[2]):
        found = wp.bool(False)
        s = wp.int32(0)
        # Most of what moves does so at once.
        while s < steps and not found:
            found = moves_at(poses[e, s, m], poses[e, steps - 1, m], twists[e, s, m])
            s += 1
        moving[e, m] = int(found)
