"""Makes the geometric images of a z-buffer: depth, ids, normals, motion, and the points that are hit."""

import warp as wp

from nodes.renderer.raster.depth_kernels import MISS, depth_of, triangle_of
from nodes.renderer.raster.lens.displacement_kernels import FAR_AWAY, SKY_NEAR, make_displacement
from nodes.renderer.raster.lens.view_kernels import CameraView, pixel_ray

wp.set_module_options({"enable_backward": False})


def make_outputs(depth: bool, motion: bool, ids: bool, normal: bool, lens: str) -> wp.Kernel:
    """Makes the kernel of the geometric images that are asked for; the arrays of the others may be empty. lens: `none`
    or a distortion."""
    bent = lens != "none"
    displacement = make_displacement(lens)

    @wp.kernel(module="unique", enable_backward=False)
    def outputs(
        # in
        view: CameraView,
        row0: int,
        span: int,
        packed: wp.array3d(dtype=wp.uint64),
        instance: wp.array(dtype=int),
        normals: wp.array(dtype=wp.vec3),
        rotation: wp.array2d(dtype=wp.mat33),
        camera: wp.array(dtype=wp.mat33),
        turn: wp.array2d(dtype=wp.mat33),
        shift: wp.array2d(dtype=wp.vec3),
        # out
        depth_out: wp.array3d(dtype=float),
        motion_out: wp.array3d(dtype=wp.vec2),
        ids_out: wp.array3d(dtype=int),
        normal_out: wp.array3d(dtype=wp.vec3),
    ):
        """Writes the geometric images of every pixel from the z-buffer.

        Args:
            row0: first row; span: pixels of a row that a thread does.
            packed: z-buffer [E, H, W].
            instance, normals: of each triangle [T]; normals in the instance's frame.
            rotation: [E, I] instance to camera.
            camera: [E] camera to world.
            turn, shift: [E, I + 1] of pose_kernels.displace_instances.
            depth_out: m along the optical axis, inf = sky.
            motion_out: px.
            ids_out: 0 = background, else instance + 1.
            normal_out: world frame, towards the camera, 0 = sky.
        """
        env, row, part = wp.tid()
        y = row0 + row
        for x in range(part * span, wp.min(part * span + span, view.width)):
            hit = packed[env, y, x]
            t = triangle_of(hit)
            z = float(wp.inf)
            i = wp.int32(-1)
            if t != MISS:
                z = depth_of(hit)
                i = instance[t]
            if wp.static(depth):
                if wp.static(bent):
                    # What is beside or behind a wide lens has a depth of 0 or less.
                    depth_out[env, y, x] = wp.where(t != MISS, z * pixel_ray(view, x, y)[2], z)
                else:
                    depth_out[env, y, x] = z
            if wp.static(ids):
                ids_out[env, y, x] = i + 1
            if wp.static(normal):
                n = wp.vec3(0.0, 0.0, 0.0)
                if t != MISS:
                    n = rotation[env, i] * normals[t]
                    if wp.dot(n, pixel_ray(view, x, y)) > 0.0:
                        n = -n
                    n = camera[env] * n
                normal_out[env, y, x] = n
            if wp.static(motion):
                d = pixel_ray(view, x, y)
                p = d
                near = wp.float32(SKY_NEAR)
                if t != MISS:
                    p = z * d
                    near = view.near
                else:
                    # The sky is the last entry: a direction, which only turns.
                    i = turn.shape[1] - 1
                m = turn[env, i] * p + shift[env, i]
                v = wp.vec2(0.0, 0.0)
                # What does not move needs no distortion, which takes longest, and is where it is also beside the lens.
                if wp.static(not bent) or m[0] != 0.0 or m[1] != 0.0 or m[2] != 0.0:
                    v = displacement(view, d, p, m, near)
                motion_out[env, y, x] = wp.vec2(
                    wp.clamp(v[0], -FAR_AWAY, FAR_AWAY), wp.clamp(v[1], -FAR_AWAY, FAR_AWAY)
                )

    return outputs


@wp.kernel
def body_points(
    # in
    view: CameraView,
    packed: wp.array3d(dtype=wp.uint64),
    instance: wp.array(dtype=int),
    rotation: wp.array2d(dtype=wp.mat33),
    translation: wp.array2d(dtype=wp.vec3),
    rest_rotation: wp.array(dtype=wp.mat33),
    rest_translation: wp.array(dtype=wp.vec3),
    # out
    triangle_out: wp.array3d(dtype=int),
    instance_out: wp.array3d(dtype=int),
    point_out: wp.array3d(dtype=wp.vec3),
):
    """Finds who is hit, and where in the frame of the body that carries it.

    Args:
        packed: z-buffer [E, H, W].
        instance: of each triangle [T].
        rotation, translation: [E, I] instance to camera.
        rest_rotation, rest_translation: [I] instance to its body.
        triangle_out: [E, H, W], MISS = nothing; likewise instance_out.
        point_out: [E, H, W] m.
    """
    env, y, x = wp.tid()
    hit = packed[env, y, x]
    t = triangle_of(hit)
    i = wp.int32(-1)
    p = wp.vec3(0.0, 0.0, 0.0)
    if t != MISS:
        i = instance[t]
        p = depth_of(hit) * pixel_ray(view, x, y)
        p = rest_rotation[i] * (wp.transpose(rotation[env, i]) * (p - translation[env, i])) + rest_translation[i]
    triangle_out[env, y, x] = t
    instance_out[env, y, x] = i
    point_out[env, y, x] = p
