"""How long things that move stay in the image, that come and go between two looks at it."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.struct
class Boxes:
    """Holds the boxes of things: which of the bodies that move they are on [J], where on it, and half their sides."""

    mover: wp.array(dtype=int)
    rotation: wp.array(dtype=wp.mat33d)
    translation: wp.array(dtype=wp.vec3d)
    half: wp.array(dtype=wp.vec3d)


@wp.func
def turned(pose: wp.transformd):
    """Makes the rotation matrix of a pose."""
    return wp.quat_to_matrix(wp.normalize(wp.transform_get_rotation(pose)))


@wp.func
def reach(normal: wp.vec3d, centre: wp.vec3d, axes: wp.mat33d, half: wp.vec3d):
    """Gives how far a box reaches over a plane through the origin, at most."""
    along = wp.transpose(axes) * normal
    return wp.dot(normal, centre) + wp.abs(along[0]) * half[0] + wp.abs(along[1]) * half[1] + wp.abs(along[2]) * half[2]


@wp.kernel
def find_visits(
    # in
    boxes: Boxes,
    camera: int,
    near: wp.float64,
    sides: wp.vec4d,
    deep: wp.float64,
    eye: wp.array(dtype=wp.transformd),
    poses: wp.array3d(dtype=wp.transformd),
    # out
    shortest: wp.array(dtype=int),
):
    """Finds the shortest visit of a box to the image, in instants: one that begins and ends within the gap, and in
    which it comes further in than `deep`.

    camera: its place among what moves, -1 where it stands at eye [E]. sides: least and greatest x / z, then y / z, of
    the image; deep: in these. poses [n, E, M]: at the instants of a gap, one after the other.
    """
    env, j = wp.tid()
    half = boxes.half[j]
    before = wp.bool(True)
    stay = wp.int32(0)
    far_in = wp.float64(0.0)
    for n in range(poses.shape[0]):
        at = eye[env]
        if camera >= 0:
            at = poses[n, env, camera]
        back = wp.transpose(turned(at))
        pose = poses[n, env, boxes.mover[j]]
        turn = back * turned(pose)
        centre = turn * boxes.translation[j] + back * (
            wp.transform_get_translation(pose) - wp.transform_get_translation(at)
        )
        axes = turn * boxes.rotation[j]
        zero = wp.float64(0.0)
        one = wp.float64(1.0)
        ahead = reach(wp.vec3d(zero, zero, one), centre, axes, half)
        inside = wp.float64(-1.0)
        if ahead > near:
            left = reach(wp.vec3d(one, zero, -sides[0]), centre, axes, half)
            right = reach(wp.vec3d(-one, zero, sides[1]), centre, axes, half)
            top = reach(wp.vec3d(zero, one, -sides[2]), centre, axes, half)
            bottom = reach(wp.vec3d(zero, -one, sides[3]), centre, axes, half)
            inside = wp.min(wp.min(left, right), wp.min(top, bottom)) / ahead
        if inside >= zero:
            if not before:
                stay += 1
                far_in = wp.max(far_in, inside)
        else:
            if stay > 0 and far_in > deep:
                wp.atomic_min(shortest, env, stay)
            before = wp.bool(False)
            stay = wp.int32(0)
            far_in = zero
