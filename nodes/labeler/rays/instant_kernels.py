"""Computes what all pixels of a camera see at one instant, and where that is at another one.

All questions have one time, so that a z-buffer answers what is seen, and poses are worked out once for each instance,
as the way from the camera's frame into the mesh's own; rays meet meshes there, as in ray_caster_kernels.
"""

import warp as wp

from nodes.labeler.rays.motion_kernels import Motion, fraction, gap_at, pose_of
from nodes.labeler.rays.ray_caster_kernels import Surfaces, beginning, first_hit, in_the_way
from nodes.renderer.geometry.triangles import SHELL_CONVEX, SHELL_PLANAR
from nodes.renderer.raster.depth_kernels import MISS, depth_of, triangle_of

wp.set_module_options({"enable_backward": False})

COVERED = wp.constant(wp.float64(1.0e-4))
"""By how much of its distance another surface has to be nearer to cover a point: above all float32 roundings."""


@wp.struct
class CameraToMesh:
    """Holds transforms of points from the camera's frame to those of E environments' meshes: p -> turn p + shift."""

    turn: wp.array2d(dtype=wp.mat33d)
    """[E, I]."""
    shift: wp.array2d(dtype=wp.vec3d)
    """[E, I] m."""


@wp.kernel
def find_camera_to_mesh(
    # in
    surfaces: Surfaces,
    motion: Motion,
    envs: wp.array(dtype=wp.int32),
    t: wp.int64,
    # out
    to_mesh: CameraToMesh,
):
    """Computes the transforms from the camera to the meshes of environments int32 [E] at an instant [ns]."""
    e, i = wp.tid()
    gap = gap_at(motion, t)
    u = fraction(motion, gap, t)
    eye = pose_of(motion, envs[e], surfaces.camera, gap, u)
    frame = wp.transform_multiply(pose_of(motion, envs[e], surfaces.body[i], gap, u), surfaces.offset[i])
    back = wp.quat_inverse(wp.transform_get_rotation(frame))
    to_mesh.turn[e, i] = wp.quat_to_matrix(wp.mul(back, wp.transform_get_rotation(eye)))
    to_mesh.shift[e, i] = wp.quat_rotate(back, wp.transform_get_translation(eye) - wp.transform_get_translation(frame))


@wp.kernel
def find_poses(
    # in
    motion: Motion,
    envs: wp.array(dtype=wp.int32),
    t: wp.int64,
    # out
    poses: wp.array2d(dtype=wp.transformd),
):
    """Works out the poses [E, N] of all bodies of environments int32 [E] at an instant [ns]."""
    e, body = wp.tid()
    gap = gap_at(motion, t)
    poses[e, body] = pose_of(motion, envs[e], body, gap, fraction(motion, gap, t))


@wp.kernel
def find_points(
    # in
    to_mesh: CameraToMesh,
    lens: wp.int32,
    directions: wp.array(dtype=wp.vec3d),
    packed: wp.array2d(dtype=wp.uint64),
    triangles: wp.array(dtype=wp.vec3i),
    owners: wp.array(dtype=wp.int32),
    corners: wp.array(dtype=wp.vec3),
    # out
    instances: wp.array2d(dtype=wp.int32),
    points: wp.array2d(dtype=wp.vec3d),
    normals: wp.array2d(dtype=wp.vec3),
):
    """Finds the surface points that pixels see: where their rays meet the planes of the triangles in a z-buffer.

    Args:
        to_mesh: where things are.
        lens: 1 where the z-buffer holds distances, else depths along the optical axis.
        directions: of the pixels [P], unit vectors in the camera's frame.
        packed: z-buffer [E, P].
        triangles, owners: corners and instance of each triangle [T].
        corners: [V] in the frames of their meshes.
        instances: [E, P] ids, 0 for the background.
        points: [E, P] in the camera's frame; NaN for the background.
        normals: [E, P] of the triangle, in its mesh's frame.
    """
    e, n = wp.tid()
    t = triangle_of(packed[e, n])
    if t == MISS:
        instances[e, n] = 0
        points[e, n] = wp.vec3d(wp.float64(wp.nan), wp.float64(wp.nan), wp.float64(wp.nan))
        return
    i = owners[t]
    d = directions[n]
    k = triangles[t]
    a = wp.vec3d(corners[k[0]])
    normal = wp.normalize(wp.cross(wp.vec3d(corners[k[1]]) - a, wp.vec3d(corners[k[2]]) - a))
    towards = to_mesh.turn[e, i] * d
    rough = wp.float64(depth_of(packed[e, n]))
    if lens == 0:
        rough = rough / d[2]
    distance = wp.dot(normal, a - to_mesh.shift[e, i]) / wp.dot(normal, towards)
    # A triangle seen along its plane says little about where it is met.
    if not (wp.abs(distance - rough) <= wp.float64(1.0e-3) * rough):
        distance = rough
    instances[e, n] = i + 1
    points[e, n] = distance * d
    normals[e, n] = wp.vec3(normal)


@wp.func
def carried_point(before: CameraToMesh, after: CameraToMesh, e: wp.int32, i: wp.int32, point: wp.vec3d):
    """Carries a point along with its body, from the camera's frame at one instant to that at another."""
    fixed = before.turn[e, i] * point + before.shift[e, i]
    return wp.transpose(after.turn[e, i]) * (fixed - after.shift[e, i])


@wp.kernel
def carry_points(
    # in
    before: CameraToMesh,
    after: CameraToMesh,
    instances: wp.array2d(dtype=wp.int32),
    points: wp.array2d(dtype=wp.vec3d),
    # out
    carried: wp.array2d(dtype=wp.vec3d),
):
    """Carries points along with their bodies, from one instant to another.

    Args:
        before, after: the to_mesh at both.
        instances, points: what pixels see [E, P], as of `find_points`.
        carried: [E, P] in the camera's frame at the other instant; NaN for the background.
    """
    e, n = wp.tid()
    i = instances[e, n] - 1
    carried[e, n] = points[e, n]
    if i >= 0:
        carried[e, n] = carried_point(before, after, e, i, points[e, n])


@wp.func
def straight_place(k: wp.mat33d, point: wp.vec3d):
    """Projects a point of the camera's frame as a pinhole does; NaN for one that no pixel could see."""
    place = wp.vec2d(wp.float64(wp.nan), wp.float64(wp.nan))
    if point[2] > wp.float64(0.0):
        x = point[0] / point[2]
        y = point[1] / point[2]
        place = wp.vec2d(k[0, 0] * x + k[0, 1] * y + k[0, 2], k[1, 1] * y + k[1, 2])
    return place


@wp.kernel
def flow_to_places(
    # in
    surfaces: Surfaces,
    before: CameraToMesh,
    to_mesh: CameraToMesh,
    shell: wp.array(dtype=wp.int32),
    k: wp.mat33d,
    width: wp.int32,
    height: wp.int32,
    instances: wp.array2d(dtype=wp.int32),
    normals: wp.array2d(dtype=wp.vec3),
    points: wp.array2d(dtype=wp.vec3d),
    places: wp.array2d(dtype=wp.vec2d),
    # out
    flow: wp.array2d(dtype=wp.vec2),
    valid: wp.array2d(dtype=wp.uint8),
):
    """Computes how far surface points move in the image, and whether they are seen where they come to.

    A ray is sent towards those alone that come into the image with their front ahead, and only up to them.

    Args:
        surfaces, before, to_mesh: what there is, where it was, and where it is when they have come there.
        width, height: of the image [px].
        shell: [I], whether an instance can cover itself (SHELL_*).
        instances, normals: of the points' surfaces [E, P], as of `find_points`.
        k: of a pinhole [px].
        points: [E, P] in the camera's frame before, as of `find_points`.
        places: [E, P] of the points in the image then [px], of a lens; empty for a pinhole.
        flow: [E, P] px, NaN for the background.
        valid: [E, P], 1 where the point is in the image and nothing covers it.
    """
    e, n = wp.tid()
    i = instances[e, n] - 1
    valid[e, n] = wp.uint8(0)
    flow[e, n] = wp.vec2(wp.nan, wp.nan)
    if i < 0:
        return
    point = carried_point(before, to_mesh, e, i, points[e, n])
    place = straight_place(k, point)
    if surfaces.lens == 1:
        place = places[e, n]
    flow[e, n] = wp.vec2(place - wp.vec2d(wp.float64(n % width), wp.float64(n // width)))
    edge = wp.float64(-0.5)
    right = wp.float64(width) + edge
    low = wp.float64(height) + edge
    # What is NaN is nowhere.
    if not (place[0] >= edge and place[0] <= right and place[1] >= edge and place[1] <= low):
        return
    far = wp.length(point)
    d = point / far
    begin = beginning(surfaces, d)
    front = wp.dot(normals[e, n], wp.vec3(to_mesh.turn[e, i] * d)) < wp.float32(0.0)
    if not (far >= begin and (front or surfaces.two_sided[i] != 0)):
        return
    alone = shell[i] == wp.static(SHELL_PLANAR) or (shell[i] == wp.static(SHELL_CONVEX) and front)
    reach = wp.float32(far * (wp.float64(1.0) - COVERED) - begin)
    for j in range(surfaces.mesh.shape[0]):
        if surfaces.mesh[j] != wp.uint64(0) and not (alone and j == i):
            towards = to_mesh.turn[e, j] * d
            local = to_mesh.shift[e, j] + begin * towards
            if in_the_way(surfaces, j, -local, towards, reach):
                distance, _normal = first_hit(surfaces, j, wp.vec3(local), wp.vec3(towards), reach)
                if distance < reach:
                    return
    valid[e, n] = wp.uint8(1)
