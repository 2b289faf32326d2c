"""Rasterises blocks of triangles, which are culled against the field of view and then walked pixel by pixel.

A block is up to clusters.SIZE consecutive triangles (or vertices) of one instance with a bounding sphere and a cone of
normals. Culling leaves out only what covers no pixel, so it changes no bit of the result.
"""

import warp as wp

from evis.gpu.bits_kernels import lowest
from nodes.renderer.raster.bounds_kernels import bounds, facing, outside, turned_away
from nodes.renderer.raster.depth_kernels import face_from
from nodes.renderer.raster.lens.distortion_kernels import make_bounds, walk_rays
from nodes.renderer.raster.lens.view_kernels import CameraView
from nodes.renderer.raster.triangle_kernels import corners_of, set_up
from nodes.renderer.raster.walk_kernels import drawable, walk_own

wp.set_module_options({"enable_backward": False})


@wp.struct
class Blocks:
    """Holds pieces [B] of the instances: items first..last - 1, bounding sphere and cone of normals in the instance's
    frame.

    cosine: of the cone's half angle; at most 0 where its back side must not be left out.
    """

    instance: wp.array(dtype=int)
    first: wp.array(dtype=int)
    last: wp.array(dtype=int)
    centre: wp.array(dtype=wp.vec3)
    radius: wp.array(dtype=float)
    extent: wp.array(dtype=float)
    """Radius of the whole instance's sphere, which is about its origin."""
    axis: wp.array(dtype=wp.vec3)
    cosine: wp.array(dtype=float)


@wp.func
def unseen(view: CameraView, row0: int, row1: int, blocks: Blocks, n: int, turn: wp.mat33, place: wp.vec3):
    """Tells whether a block covers no pixel of rows row0..row1 - 1."""
    centre = turn * blocks.centre[n] + place
    if outside(view, row0, row1, centre, blocks.radius[n]):
        return True
    # The vertices of an instance that is outside as a whole are not there, though a block's sphere may stick out.
    if outside(view, 0, view.height, place, blocks.extent[n]):
        return True
    return turned_away(turn * blocks.axis[n], blocks.cosine[n], centre, blocks.radius[n])


@wp.func
def before_near(view: CameraView, a: wp.vec3, b: wp.vec3, c: wp.vec3):
    """Tells whether any of a triangle can lie before the near plane; a lens measures that along its rays."""
    return view.distorted == 1 or wp.max(a[2], wp.max(b[2], c[2])) >= view.near


@wp.kernel
def to_camera(
    # in
    view: CameraView,
    block0: int,
    blocks: Blocks,
    points: wp.array(dtype=wp.vec3),
    rotation: wp.array2d(dtype=wp.mat33),
    translation: wp.array2d(dtype=wp.vec3),
    # out
    vertices: wp.array2d(dtype=wp.vec3),
):
    """Turns the vertices of the instances that may be seen to the camera.

    Args:
        block0: first of the blocks of vertices.
        points: [V] in the frames of their instances.
        rotation, translation: [E, I] instance to camera.
        vertices: [E, V] in the camera's frame.
    """
    env, block = wp.tid()
    b = block0 + block
    i = blocks.instance[b]
    r = rotation[env, i]
    t = translation[env, i]
    if not outside(view, 0, view.height, t, blocks.extent[b]):
        for v in range(blocks.first[b], blocks.last[b]):
            vertices[env, v] = r * points[v] + t


def make_raster(lens: str) -> wp.Kernel:
    """Makes the kernel `raster`, a thread per block, for rows row0..row1 - 1. lens: `none` or a distortion model."""
    bounds_of = make_bounds(lens) if lens != "none" else bounds
    walk_over = walk_rays if lens != "none" else walk_own

    @wp.func
    def draw(
        view: CameraView,
        row0: int,
        row1: int,
        sides: int,
        turn: wp.mat33,
        place: wp.vec3,
        vertices: wp.array2d(dtype=wp.vec3),
        triangles: wp.array(dtype=wp.vec3i),
        env: int,
        t: int,
        packed: wp.array3d(dtype=wp.uint64),
    ):
        """Draws triangle t, if it may be seen."""
        a, b, c = corners_of(view, vertices, triangles, turn, place, env, t)
        if facing(a, b, c, sides) and before_near(view, a, b, c):
            s = set_up(view, a, b, c, bounds_of(view, a, b, c))
            face = face_from(t, s.offset)
            walk_over(view, s, s.x0, s.x1, wp.max(s.y0, row0), wp.min(s.y1, row1 - 1), env, face, packed)

    @wp.kernel(module="unique", enable_backward=False)
    def raster(
        # in
        view: CameraView,
        row0: int,
        row1: int,
        block0: int,
        blocks: Blocks,
        two_sided: wp.array(dtype=int),
        rotation: wp.array2d(dtype=wp.mat33),
        translation: wp.array2d(dtype=wp.vec3),
        vertices: wp.array2d(dtype=wp.vec3),
        triangles: wp.array(dtype=wp.vec3i),
        # out
        packed: wp.array3d(dtype=wp.uint64),
    ):
        """Draws the triangles of a block that may be seen into the z-buffer, rows row0..row1 - 1.

        Args:
            block0: first of the blocks of triangles.
            two_sided: [I] whether an instance shows its back.
            rotation, translation: [E, I] instance to camera.
            vertices: [E, V] of `to_camera`.
            triangles: [T] vertices of each.
            packed: z-buffer [E, H, W].
        """
        env, block = wp.tid()
        n = block0 + block
        i = blocks.instance[n]
        turn = rotation[env, i]
        place = translation[env, i]
        if unseen(view, row0, row1, blocks, n, turn, place):
            return
        sides = two_sided[i]
        first = blocks.first[n]
        last = blocks.last[n]
        if wp.static(lens == "none"):
            # Most triangles cover no pixel, and are left out together.
            left = drawable(view, row0, row1, vertices, triangles, env, first, last, sides == 1)
            while left != wp.uint64(0):
                t = first + lowest(left)
                left = left & (left - wp.uint64(1))
                draw(view, row0, row1, sides, turn, place, vertices, triangles, env, t, packed)
        else:
            for t in range(first, last):
                draw(view, row0, row1, sides, turn, place, vertices, triangles, env, t, packed)

    return raster
