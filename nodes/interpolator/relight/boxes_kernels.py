"""Tests what may be in the way of light by the casters' boxes: it misses none, and is cheaper than a ray against
triangles."""

import warp as wp

from evis.gpu.reading_kernels import vector_at
from nodes.renderer.lights.light_kernels import DIRECTIONAL, FAR
from nodes.renderer.shadows.ray_kernels import Casters, hits_box, hits_sphere, inverse_of, rotation_of, translation_of

wp.set_module_options({"enable_backward": False})


@wp.struct
class Swept:
    """Holds boxes lower, upper [E, M + 1] of all places that moving bodies take in the gap, the first one around all
    others, in the world's axes about a fixed origin [m].

    size [M]: radius of a ball about each of these bodies [m]. place [P E]: of the cameras. lamp [L]: positions of
    lights with shadows that stand still, or unit vectors towards those of kind 0; radius [L]: of their extents. masks
    [E, I, L]: of instances that rest, bit k % 32 where body k may hide a light from some point of one. blur: as
    of Change, 0 for a camera that stands still: what rests is looked up in its own pixel there.
    """

    lower: wp.array2d(dtype=wp.vec3)
    upper: wp.array2d(dtype=wp.vec3)
    size: wp.array(dtype=float)
    place: wp.array(dtype=wp.vec3)
    lamp: wp.array(dtype=wp.vec3)
    radius: wp.array(dtype=float)
    kind: wp.array(dtype=int)
    masks: wp.array3d(dtype=wp.uint32)
    blur: float


@wp.func
def bit(k: int):
    """Gives the bit of the k-th body in a mask of 32."""
    return wp.uint32(1) << wp.uint32(k % 32)


ROUNDED = wp.constant(1.0e-5)
"""Error of a place, of its distance, that single precision may make, with room to spare."""

LOWEST = """
#if defined(__CUDA_ARCH__)
    return __ffs(mask) - 1;
#else
    return __builtin_ctz(mask);
#endif
"""


@wp.func_native(LOWEST)
def lowest(mask: wp.uint32) -> wp.int32:
    """Gives the number of the lowest bit of a mask, which is not 0."""
    ...


@wp.func
def way_to(swept: Swept, l: int, at: wp.vec3):
    """Gives the way from a place to a light that stands still, and how many times as long it is."""
    way = swept.lamp[l]
    length = FAR
    if swept.kind[l] != DIRECTIONAL:
        way = way - at
        length = 1.0
    return way, length


@wp.func
def crossed(swept: Swept, env: int, eye: wp.mat33, row: int, instance: int, position: wp.vec3):
    """Tells whether anything that moves may come between a light that stands still and what is about a point of an
    instance that rests, which the camera of a slot's row sees there, at any time of the gap. eye: that camera to
    world."""
    at = eye * position + swept.place[row]
    pad = (ROUNDED + swept.blur) * wp.length(position) + ROUNDED * wp.length(at)
    for l in range(swept.lamp.shape[0]):
        mask = swept.masks[env, instance, l]
        if mask != wp.uint32(0):
            way, length = way_to(swept, l, at)
            inverse = inverse_of(way)
            wide = (pad + swept.radius[l]) * wp.vec3(1.0, 1.0, 1.0)
            low = at + wide
            high = at - wide
            # The box around all and those of single bodies by one test, of which a second copy would cost registers.
            boxes = swept.lower.shape[1]
            k = wp.int32(0)
            while k >= 0:
                box = env * boxes + k
                met = hits_box(vector_at(swept.lower, box) - low, vector_at(swept.upper, box) - high, inverse, length)
                if k > 0 and met:
                    return True
                if k > 0 and k + 32 < boxes:
                    k += 32
                elif mask != wp.uint32(0) and (k > 0 or met):
                    k = 1 + lowest(mask)
                    mask = mask & (mask - wp.uint32(1))
                else:
                    k = wp.int32(-1)
    return False


@wp.func
def nearby(swept: Swept, env: int, eye: wp.mat33, row: int, position: wp.vec3):
    """Bounds the share of the sky over a point that moving bodies fill at any time of the gap: the sum of the squares
    of their size over their distance, each 1 at most. eye, row, position: as of
    `crossed`."""
    at = eye * position + swept.place[row]
    share = float(0.0)
    for k in range(swept.size.shape[0]):
        below = wp.max(swept.lower[env, k + 1] - at, wp.vec3(0.0, 0.0, 0.0))
        beyond = wp.max(at - swept.upper[env, k + 1], wp.vec3(0.0, 0.0, 0.0))
        away = wp.length(below + beyond)
        share += wp.pow(swept.size[k] / wp.max(away, swept.size[k]), 2.0)
    return share


@wp.func
def any_box_may_hide(
    casters: Casters,
    half: wp.array(dtype=wp.vec3),
    row: int,
    first: int,
    skip: int,
    origin: wp.vec3,
    ray: wp.vec3,
    length: float,
    wide: float,
    beside: float,
):
    """Tells whether the box of any caster order[first ..] but `skip` may hide a light from a point.

    Args:
        half: half the sides of the instances' boxes, in their frames [m].
        row: of the casters' places.
        origin, ray, length: point, unit vector towards the light's middle, and its distance [m].
        wide: radius of the light, 0 for one without size [m].
        beside: how far from the point it counts too [m].
    """
    for k in range(first, casters.order.shape[0]):
        i = casters.order[k]
        if i != skip:
            centre = translation_of(casters, row, i) - origin
            # Seen from the point, the light is a cone that is as wide as that at the caster's far side.
            reach = wp.dot(centre, ray) + casters.radius[i]
            around = beside + wide * wp.clamp(reach / length, 0.0, 1.0)
            if hits_sphere(centre, casters.radius[i] + around, ray, length):
                inverse = wp.transpose(rotation_of(casters, row, i))
                at = inverse * centre
                # A ray that grazes a face must not be missed for its rounding.
                sides = half[i] + (around + ROUNDED * (wp.length(centre) + casters.radius[i])) * wp.vec3(1.0, 1.0, 1.0)
                if hits_box(at - sides, at + sides, inverse_of(inverse * ray), length):
                    return True
    return False
