"""Computes how far pixels move in a gap, from how far they moved in the one before."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def go_on(
    # in
    pace: wp.array(dtype=wp.float32),
    motion: wp.array4d(dtype=wp.float32),
    # out
    onward: wp.array4d(dtype=wp.float32),
):
    """Computes the motion [px] of a gap `pace` times as long, [E], at the same speed."""
    env, y, x = wp.tid()
    onward[env, y, x, 0] = pace[env] * motion[env, y, x, 0]
    onward[env, y, x, 1] = pace[env] * motion[env, y, x, 1]
