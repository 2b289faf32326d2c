"""Computes the labels that look at every pixel, in Warp kernels."""

from __future__ import annotations

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def flow_of_pixels(
    # in
    rays: wp.array2d(dtype=wp.vec3d),
    image: wp.array3d(dtype=wp.vec3d),
    motions: wp.array3d(dtype=wp.vec3d),
    depth: wp.array3d(dtype=wp.float32),
    ids: wp.array3d(dtype=wp.int32),
    # out
    flow: wp.array4d(dtype=wp.float32),
    strange: wp.array(dtype=wp.int32),
):
    """Computes the image velocity of every pixel, (5.16) in Ma et al., An Invitation to 3-D Vision.

    Args:
        rays: points [H, W] at z = 1.
        image: d(pixel) / d(X, Y, Z) there [H, W, 2], a row for u and one for v.
        motions: (b, w) of each id [E, ids, 2], m/s and rad/s in the camera frame.
        depth: [E, H, W] m.
        ids: [E, H, W].
        flow: [E, H, W, 2] px/s, NaN where depth is not finite.
        strange: the largest and the least id [2] that has no motion, if it is larger or less than what is there.
    """
    env, i, j = wp.tid()
    z, number = depth[env, i, j], ids[env, i, j]
    known = number >= 0 and number < motions.shape[1]
    if not known:
        wp.atomic_max(strange, 0, number)
        wp.atomic_min(strange, 1, number)
    if not known or not wp.isfinite(z):
        flow[env, i, j, 0] = wp.nan
        flow[env, i, j, 1] = wp.nan
        return
    # The projection's derivative at X = z ray: the translation is divided by z, the rotation is not.
    moving = motions[env, number, 0] / wp.float64(z) + wp.cross(motions[env, number, 1], rays[i, j])
    flow[env, i, j, 0] = wp.float32(wp.dot(image[i, j, 0], moving))
    flow[env, i, j, 1] = wp.float32(wp.dot(image[i, j, 1], moving))


@wp.kernel
def extents(
    # in
    ids: wp.array3d(dtype=wp.int32),
    # out
    least: wp.array3d(dtype=wp.int32),
    most: wp.array3d(dtype=wp.int32),
):
    """Finds the least and the largest column and row [E, ids, 2] of the pixels of every id; a thread takes a row."""
    env, i = wp.tid()
    width = ids.shape[2]
    j = wp.int32(0)
    while j < width:
        number = ids[env, i, j]
        first = j
        while j < width and ids[env, i, j] == number:
            j += 1
        wp.atomic_min(least, env, number, 0, first)
        wp.atomic_min(least, env, number, 1, i)
        wp.atomic_max(most, env, number, 0, j - 1)
        wp.atomic_max(most, env, number, 1, i)
