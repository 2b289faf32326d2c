"""Draws the rows of the z-buffer that a CPU's thread owns: which triangles they show, and the walk over these.

Both are done in C++, several triangles or pixels at a time: over the strides of a Warp array no loop is vectorised.
"""

from pathlib import Path

import warp as wp

from evis.native_code import native_code
from nodes.renderer.raster.lens.view_kernels import CameraView
from nodes.renderer.raster.triangle_kernels import Setup, columns_of, row_share, run_of, walk_all

wp.set_module_options({"enable_backward": False})

RUN = wp.constant(8)
"""Pixels of a row that are done at a time, as in walk.h."""
NARROW = wp.constant(24)
"""Columns from which on each row of a triangle is narrowed to what its edges leave."""
WALK, DRAWABLE = (Path(__file__).with_name(name) for name in ("walk.h", "drawable.h"))
COVER = "cover_box(columns, rows, packed, env, x0, x1, y0, y1, e0, e1, e2, slack, normal, plane, near, face);"
CHOOSE = "return drawable(view, row0, row1, vertices, triangles, env, first, last, two_sided);"


@wp.func_native(native_code([DRAWABLE], CHOOSE))
def drawable(
    view: CameraView,
    row0: int,
    row1: int,
    vertices: wp.array2d(dtype=wp.vec3),
    triangles: wp.array(dtype=wp.vec3i),
    env: int,
    first: int,
    last: int,
    two_sided: bool,
) -> wp.uint64:
    """Gives which of the triangles first .. last - 1, 64 at most, may cover a pixel of rows row0 .. row1 - 1 through a
    pinhole: a bit for each."""
    ...


@wp.func_native(native_code([WALK], COVER))
def cover_box(
    columns: wp.array(dtype=wp.float32),
    rows: wp.array(dtype=wp.float32),
    packed: wp.array3d(dtype=wp.uint64),
    env: int,
    x0: int,
    x1: int,
    y0: int,
    y1: int,
    e0: wp.vec3,
    e1: wp.vec3,
    e2: wp.vec3,
    slack: wp.vec3,
    normal: wp.vec3,
    plane: wp.vec3,
    near: float,
    face: int,
):
    """Writes the pixels of a triangle inside a box into the z-buffer."""
    ...


@wp.func
def walk_own(
    view: CameraView,
    s: Setup,
    x0: int,
    x1: int,
    y0: int,
    y1: int,
    env: int,
    face: int,
    packed: wp.array3d(dtype=wp.uint64),
):
    """Writes the same pixels as triangle_kernels.walk, where no other thread writes to these rows."""
    plane = wp.vec3(s.offset, s.z_min, s.z_max)
    if view.width < RUN:
        walk_all(view, s, x0, x1, y0, y1, env, face, packed)
    elif x1 - x0 < NARROW:
        cover_box(
            view.columns, view.rows, packed, env, x0, x1, y0, y1, s.e0, s.e1, s.e2, s.slack, s.normal, plane,
            view.near, face,
        )  # fmt: skip
    else:
        centre = view.cx + float(view.margin)
        run = wp.vec3(run_of(view, s.e0), run_of(view, s.e1), run_of(view, s.e2))
        for y in range(y0, y1 + 1):
            span = columns_of(run, row_share(view, s, y), centre, x0, x1)
            cover_box(
                view.columns, view.rows, packed, env, span[0], span[1], y, y, s.e0, s.e1, s.e2, s.slack, s.normal,
                plane, view.near, face,
            )  # fmt: skip
