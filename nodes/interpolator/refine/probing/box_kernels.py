"""Describes the boxes about instances, and how far they reach over a plane."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.struct
class Boxes:
    """Holds the boxes of things: which of the bodies that move they are on [J], where on it, and half their sides.

    fine: half of how wide their parts and holes are along these sides, for `find_shortest_shadows`.
    """

    mover: wp.array(dtype=int)
    rotation: wp.array(dtype=wp.mat33d)
    translation: wp.array(dtype=wp.vec3d)
    half: wp.array(dtype=wp.vec3d)
    fine: wp.array(dtype=wp.vec3d)


@wp.func
def reach(normal: wp.vec3d, centre: wp.vec3d, axes: wp.mat33d, half: wp.vec3d):
    """Gives how far a box reaches over a plane through the origin, at most."""
    along = wp.transpose(axes) * normal
    return wp.dot(normal, centre) + wp.abs(along[0]) * half[0] + wp.abs(along[1]) * half[1] + wp.abs(along[2]) * half[2]
