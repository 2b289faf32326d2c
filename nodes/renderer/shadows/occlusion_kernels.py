"""Computes where the trees over occluders are at an instant."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

ROUNDING = wp.constant(4.0e-6)
"""Of positions in float32, of the size of the frame that they are in, with a margin."""


@wp.kernel
def place_trees(
    # in
    poses: wp.array2d(dtype=wp.transformd),
    camera: int,
    middle: wp.vec3d,
    size: float,
    # out
    shift: wp.array(dtype=wp.vec3),
    pad: wp.array(dtype=float),
):
    """Places the camera in the frame of the still tree, which has the world's axes about `middle` and this size [m]."""
    env = wp.tid()
    s = wp.vec3(wp.transform_get_translation(poses[env, camera]) - middle)
    shift[env] = s
    pad[env] = ROUNDING * (size + wp.length(s))


@wp.kernel
def place_boxes(
    # in
    instances: wp.array(dtype=int),
    half: wp.array(dtype=wp.vec3),
    rotation: wp.array2d(dtype=wp.mat33),
    translation: wp.array2d(dtype=wp.vec3),
    # out
    lower: wp.array2d(dtype=wp.vec3),
    upper: wp.array2d(dtype=wp.vec3),
    pad_bits: wp.array(dtype=int),
):
    """Computes the boxes of the moving instances in the camera's frame.

    Args:
        instances: [M] those that move.
        half: [I] half the size of each box in its instance's frame [m].
        rotation, translation: [E, I] instance to camera.
        lower, upper: [E, M] m.
        pad_bits: [E] rounding of a place, as bits, which sort as floats of at least 0 do.
    """
    env, m = wp.tid()
    i = instances[m]
    turn = rotation[env, i]
    h = half[i]
    reach = wp.vec3(
        wp.abs(turn[0, 0]) * h[0] + wp.abs(turn[0, 1]) * h[1] + wp.abs(turn[0, 2]) * h[2],
        wp.abs(turn[1, 0]) * h[0] + wp.abs(turn[1, 1]) * h[1] + wp.abs(turn[1, 2]) * h[2],
        wp.abs(turn[2, 0]) * h[0] + wp.abs(turn[2, 1]) * h[1] + wp.abs(turn[2, 2]) * h[2],
    )
    centre = translation[env, i]
    lower[env, m] = centre - reach
    upper[env, m] = centre + reach
    wp.atomic_max(pad_bits, env, wp.cast(ROUNDING * (wp.length(centre) + wp.length(reach)), wp.int32))
