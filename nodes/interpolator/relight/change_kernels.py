"""Describes what may change the light of a gap, and the surface points that are asked whether it does: at an instant,
and where they were at both keyframes."""

import warp as wp

from nodes.interpolator.displacement_kernels import BodyMotion, displaced, turned_back
from nodes.interpolator.relight.boxes_kernels import Swept
from nodes.renderer.lights.light_kernels import Lights
from nodes.renderer.lights.sky_kernels import Sky
from nodes.renderer.raster.depth_kernels import triangle_of
from nodes.renderer.shadows.ray_kernels import CONVEX, PLANAR, Casters, rotation_of

wp.set_module_options({"enable_backward": False})

MOVED = wp.constant(1)
"""Flag of a body that moves against a light in the gap."""
SHADED = wp.constant(2)
"""Flag of one that does not, and on which shadows of others may move."""
LIT_ANEW = wp.constant(4)
"""Flag of one that light reaches over other surfaces and that moves, or whose light comes from something that does."""
VIEWED = wp.constant(8)
"""Flag of a point, if glossy, that the view may have turned against by more than its lobe is wide."""
AROUND = wp.constant(16)
"""Flag of one that stands still and is lit over other surfaces, some of which move."""
OPEN = wp.constant(32)
"""Flag of a point of something that moves, between which and all lights nothing but itself may be in the gap."""
LEAST_COSINE = wp.constant(0.1)
"""Least cosine between view and normal for which the width of a pixel on a surface is worked out."""


@wp.struct
class Change:
    """Holds the lights and casters of the slots (`now`, rows P E) and of both keyframes (`then`, rows 2 E).

    eye_then: cameras to world; place_then: where they are, as `place` of Swept. flags int32 [E, N + 1]: of bodies and
    the world, see MOVED. open int32 [E, I]: 1 for instances whose points are OPEN; of many casters, or lights that
    move, it has no elements. instance, normals: of
    triangles; alpha: of an instance's material, -1 for a plain one; half: of its box [m]; weight: luminance of lights.
    carried: 1 for instances whose radiance goes as what falls on them; least: least alpha there is. even: change of ln
    I that still counts as none; bend: by how much a line may be off; turned: angle, of alpha, up to which a highlight
    changes evenly; blur: from a shadow's edge, up to which a look-up in a keyframe mixes both sides of it [rad].
    """

    now: Lights
    then: Lights
    casters: Casters
    casters_then: Casters
    sky: Sky
    swept: Swept
    eye_then: wp.array(dtype=wp.mat33)
    place_then: wp.array(dtype=wp.vec3)
    flags: wp.array2d(dtype=int)
    open: wp.array2d(dtype=int)
    instance: wp.array(dtype=int)
    normals: wp.array(dtype=wp.vec3)
    alpha: wp.array(dtype=float)
    half: wp.array(dtype=wp.vec3)
    weight: wp.array(dtype=float)
    carried: wp.array(dtype=int)
    least: float
    even: float
    bend: float
    turned: float
    blur: float


@wp.struct
class Point:
    """Holds a surface point in the frame of a camera, with the normal that faces it and the instance it is of; skip:
    the caster that cannot shade it, or -1."""

    position: wp.vec3
    normal: wp.vec3
    instance: int
    skip: int


@wp.func
def point_of(change: Change, casters: Casters, row: int, hit: wp.uint64, position: wp.vec3):
    """Gives the surface point that a pixel shows; casters, row: of the slots and its row, or of the keyframes."""
    t = triangle_of(hit)
    s = Point()
    s.position = position
    s.instance = change.instance[t]
    s.normal = rotation_of(casters, row, s.instance) * change.normals[t]
    shell = casters.shell[s.instance]
    s.skip = -1
    if wp.dot(s.normal, position) > 0.0:
        s.normal = -s.normal
        if shell == PLANAR:
            s.skip = s.instance
    elif shell == PLANAR or shell == CONVEX:
        s.skip = s.instance
    return s


@wp.struct
class Displacements:
    """Holds how the bodies of slots have moved since keyframe A, then since B, as displacement_kernels has it; entry
    `at` of a body in memory, `behind` more of the same since B."""

    motions: wp.array2d(dtype=BodyMotion)
    at: int
    behind: int


@wp.func
def point_then(s: Point, moves: Displacements, k: int):
    """Computes where a point is in the camera frame of keyframe A (k = 0) or B (1)."""
    at = moves.at + k * moves.behind
    r = s
    r.position = s.position + displaced(moves.motions, at, s.position)
    r.normal = turned_back(moves.motions, at, s.normal)
    return r


@wp.func
def in_the_open(flag: int, s: Point):
    """Tells whether nothing can shade a point that is OPEN, not even its own instance."""
    return (flag & OPEN) != 0 and s.skip == s.instance


@wp.func
def may_be_shaded(flag: int, s: Point):
    """Tells whether anything may come between a point of these flags and a light."""
    return ((flag & MOVED) != 0 and not in_the_open(flag, s)) or (flag & SHADED) != 0


@wp.func
def first_caster(change: Change, flag: int):
    """Gives the number, in the casters' order, from which on they may change a shadow on a point of these flags: what
    stands still changes none on what does."""
    return wp.where((flag & MOVED) != 0, 0, change.casters.still)
