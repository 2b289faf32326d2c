"""Computes boxes of all places that moving things take in a gap, in float64: only the result is rounded to float32."""

import warp as wp

from nodes.renderer.geometry.pose_kernels import matrix_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def sweep(
    # in
    poses: wp.array3d(dtype=wp.transformd),
    origin: wp.vec3d,
    first: wp.array(dtype=int),
    rotation: wp.array(dtype=wp.mat33d),
    translation: wp.array(dtype=wp.vec3d),
    half: wp.array(dtype=wp.vec3d),
    # out
    lower: wp.array2d(dtype=wp.vec3),
    upper: wp.array2d(dtype=wp.vec3),
):
    """Computes the box [E, M + 1] about a body's casters at all instants, in the world's axes about an origin [m]; the
    first one of an environment is that of `enclose`.

    Args:
        poses: [T, E, M] of the bodies to the world.
        origin: m.
        first: [M + 1] of each body's casters, and behind the last one's.
        rotation, translation, half: [I] casters to their body, and half the sides of their boxes [m].
    """
    env, body = wp.tid()
    most = wp.float64(wp.inf)
    low = wp.vec3d(most, most, most)
    high = -low
    for k in range(poses.shape[0]):
        pose = poses[k, env, body]
        turn = matrix_of(wp.transform_get_rotation(pose))
        place = wp.transform_get_translation(pose)
        for i in range(first[body], first[body + 1]):
            centre = place + turn * translation[i] - origin
            axes = turn * rotation[i]
            sides = wp.vec3d()
            for row in range(3):
                for column in range(3):
                    sides[row] = sides[row] + wp.abs(axes[row, column]) * half[i][column]
            low = wp.min(low, centre - sides)
            high = wp.max(high, centre + sides)
    lower[env, body + 1] = wp.vec3(low)
    upper[env, body + 1] = wp.vec3(high)


@wp.kernel
def enclose(
    # in and out
    lower: wp.array2d(dtype=wp.vec3),
    upper: wp.array2d(dtype=wp.vec3),
):
    """Writes the box around all others of an environment before them."""
    env = wp.tid()
    most = float(wp.inf)
    low = wp.vec3(most, most, most)
    high = -low
    for k in range(1, lower.shape[1]):
        low = wp.min(low, lower[env, k])
        high = wp.max(high, upper[env, k])
    lower[env, 0] = low
    upper[env, 0] = high
