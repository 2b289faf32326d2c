"""Draws one triangle into the z-buffer: its edges and plane, and a walk over the pixels that it may cover.

Everything is camera-relative (x right, y down, z forward). A pixel's ray is d = ((x - cx) / fx, (y - cy) / fy, 1), so a
point on it is z d; through a distorting lens d is a unit vector from a table, and the point is its distance times d.
Coverage is tested in homogeneous form (Olano and Greer, Triangle Scan Conversion using 2D Homogeneous Coordinates,
1997): pixel d lies in triangle a b c when (a x b) . d, (b x c) . d and (c x a) . d have one sign. That is the ray test
itself, so it is as exact through a lens, and a triangle that reaches behind the camera needs no new vertices; only its
bounds are clipped at the near plane. Edges are moved outwards by the rounding of the test, so a pixel centre on an edge
or a vertex belongs to all its triangles and is never missed by all.
"""

import warp as wp

from evis.gpu.reading_kernels import corners_at, number, vector_at, vector_four
from nodes.renderer.raster.depth_kernels import put_depth
from nodes.renderer.raster.lens.view_kernels import CameraView

wp.set_module_options({"enable_backward": False})

NARROW = wp.constant(6)
"""Columns from which on each row of a triangle is narrowed to what its edges leave."""


@wp.struct
class Setup:
    """Holds a triangle ready to be walked: edge normals signed so that inside is >= -slack, plane, depth range,
    bounds."""

    e0: wp.vec3
    e1: wp.vec3
    e2: wp.vec3
    slack: wp.vec3
    normal: wp.vec3
    offset: float
    z_min: float
    z_max: float
    x0: int
    x1: int
    y0: int
    y1: int


SETUP_QUADS = wp.constant(6)
"""Quadruples of numbers that a Setup takes in memory: a GPU reads one of them as fast as a single number."""


@wp.func
def store_setup(setups: wp.array3d(dtype=wp.vec4), region: int, place: int, s: Setup):
    """Writes a Setup into setups [regions, places, SETUP_QUADS]; whole numbers by their bits."""
    setups[region, place, 0] = wp.vec4(s.e0[0], s.e0[1], s.e0[2], s.slack[0])
    setups[region, place, 1] = wp.vec4(s.e1[0], s.e1[1], s.e1[2], s.slack[1])
    setups[region, place, 2] = wp.vec4(s.e2[0], s.e2[1], s.e2[2], s.slack[2])
    setups[region, place, 3] = wp.vec4(s.normal[0], s.normal[1], s.normal[2], s.offset)
    setups[region, place, 4] = wp.vec4(s.z_min, s.z_max, 0.0, 0.0)
    setups[region, place, 5] = wp.vec4(
        wp.cast(s.x0, wp.float32), wp.cast(s.x1, wp.float32), wp.cast(s.y0, wp.float32), wp.cast(s.y1, wp.float32)
    )


@wp.func
def stored_setup(setups: wp.array3d(dtype=wp.vec4), region: int, place: int):
    """Reads the Setup that `store_setup` wrote there."""
    at = (region * setups.shape[1] + place) * SETUP_QUADS
    a = vector_four(setups, at)
    b = vector_four(setups, at + 1)
    c = vector_four(setups, at + 2)
    plane = vector_four(setups, at + 3)
    depths = vector_four(setups, at + 4)
    box = vector_four(setups, at + 5)
    s = Setup()
    s.e0 = wp.vec3(a[0], a[1], a[2])
    s.e1 = wp.vec3(b[0], b[1], b[2])
    s.e2 = wp.vec3(c[0], c[1], c[2])
    s.slack = wp.vec3(a[3], b[3], c[3])
    s.normal = wp.vec3(plane[0], plane[1], plane[2])
    s.offset = plane[3]
    s.z_min = depths[0]
    s.z_max = depths[1]
    s.x0 = wp.cast(box[0], wp.int32)
    s.x1 = wp.cast(box[1], wp.int32)
    s.y0 = wp.cast(box[2], wp.int32)
    s.y1 = wp.cast(box[3], wp.int32)
    return s


@wp.func
def corner(view: CameraView, vertices: wp.array2d(dtype=wp.vec3), turn: wp.mat33, place: wp.vec3, env: int, k: int):
    """Gives vertex k in the camera frame; turn, place: the pose of the instance that it belongs to."""
    if view.local == 1:
        return turn * vector_at(vertices, k) + place
    return vertices[env, k]


@wp.func
def corners_of(
    view: CameraView,
    vertices: wp.array2d(dtype=wp.vec3),
    triangles: wp.array(dtype=wp.vec3i),
    turn: wp.mat33,
    place: wp.vec3,
    env: int,
    t: int,
):
    """Fetches the three corners of triangle t in the camera frame; turn, place: the pose of its instance."""
    k = corners_at(triangles, t)
    a = corner(view, vertices, turn, place, env, k[0])
    b = corner(view, vertices, turn, place, env, k[1])
    return a, b, corner(view, vertices, turn, place, env, k[2])


@wp.func
def edge_normal(a: wp.vec3, b: wp.vec3):
    """Gives a x b, as a x (b - a) to keep the digits of a short edge."""
    return wp.cross(a, b - a)


@wp.func
def edge_slack(view: CameraView, a: wp.vec3, b: wp.vec3):
    """Gives the bound of the rounding of edge_normal(a, b) . d over the image; it widens a triangle by some 1e-4 px."""
    return 6.0e-7 * wp.sqrt(wp.dot(a, a) * wp.dot(b - a, b - a)) * view.reach


@wp.func
def set_up(view: CameraView, a: wp.vec3, b: wp.vec3, c: wp.vec3, box: wp.vec4):
    """Gives a triangle within `box`; x1 < x0 where that holds no pixel centre of the image."""
    s = Setup()
    s.x0 = wp.max(int(wp.ceil(box[0])), 0)
    s.x1 = wp.min(int(wp.floor(box[1])), view.width - 1)
    s.y0 = wp.max(int(wp.ceil(box[2])), 0)
    s.y1 = wp.min(int(wp.floor(box[3])), view.height - 1)
    if s.x1 < s.x0 or s.y1 < s.y0:
        s.x1 = s.x0 - 1
        return s
    normal = wp.cross(b - a, c - a)
    offset = wp.dot(normal, a)
    sign = wp.where(offset > 0.0, 1.0, -1.0)
    s.e0 = sign * edge_normal(b, c)
    s.e1 = sign * edge_normal(c, a)
    s.e2 = sign * edge_normal(a, b)
    s.slack = wp.vec3(edge_slack(view, b, c), edge_slack(view, c, a), edge_slack(view, a, b))
    s.normal = normal
    s.offset = offset
    if view.distorted == 1:
        s.z_min = wp.max(wp.abs(offset) / wp.length(normal), view.near)
        s.z_max = wp.max(wp.length(a), wp.max(wp.length(b), wp.length(c)))
    else:
        s.z_min = wp.max(wp.min(a[2], wp.min(b[2], c[2])), view.near)
        s.z_max = wp.max(a[2], wp.max(b[2], c[2]))
    return s


@wp.func
def run_of(view: CameraView, edge: wp.vec3):
    """Gives columns that an edge goes on for a unit of its function; 0 for one along the rows, which narrows none of
    them."""
    if wp.abs(edge[0]) <= 1.0e-5 * (wp.abs(edge[1]) + wp.abs(edge[2])):
        return 0.0
    return view.fx / edge[0]


@wp.func
def narrow(run: float, row: float, centre: float, span: wp.vec2):
    """Gives the columns of a row that an edge may leave, one pixel more than exact."""
    x = centre - row * run
    if run > 0.0:
        return wp.vec2(wp.max(span[0], x - 1.0), span[1])
    if run < 0.0:
        return wp.vec2(span[0], wp.min(span[1], x + 1.0))
    return span


@wp.func
def cover(
    view: CameraView,
    s: Setup,
    r: wp.vec4,
    x: int,
    y: int,
    env: int,
    face: int,
    packed: wp.array3d(dtype=wp.uint64),
):
    """Writes a pixel of a triangle into the z-buffer if it covers it; r: the row's share of edges and plane."""
    dx = number(view.columns, x)
    if s.e0[0] * dx + r[0] >= 0.0 and s.e1[0] * dx + r[1] >= 0.0 and s.e2[0] * dx + r[2] >= 0.0:
        z = s.offset / (s.normal[0] * dx + r[3])
        # The depth range bounds what rounding can do to a triangle seen almost edge-on.
        if z >= view.near:
            put_depth(packed, env, y, x, wp.clamp(z, s.z_min, s.z_max), face)


@wp.func
def row_share(view: CameraView, s: Setup, y: int):
    """Gives what of the edge functions and the plane's is the same for a row of pixels."""
    dy = number(view.rows, y)
    return wp.vec4(
        s.e0[1] * dy + s.e0[2] + s.slack[0],
        s.e1[1] * dy + s.e1[2] + s.slack[1],
        s.e2[1] * dy + s.e2[2] + s.slack[2],
        s.normal[1] * dy + s.normal[2],
    )


@wp.func
def runs_of(view: CameraView, s: Setup, x0: int, x1: int):
    """Gives `run_of` the edges, or 0 where there are few columns: these are tried sooner than the edges' ends are
    found."""
    if x1 - x0 >= NARROW:
        return wp.vec3(run_of(view, s.e0), run_of(view, s.e1), run_of(view, s.e2))
    return wp.vec3(0.0, 0.0, 0.0)


@wp.func
def columns_of(run: wp.vec3, r: wp.vec4, centre: float, x0: int, x1: int):
    """Gives the first and last of the columns x0..x1 of a row that the edges leave; the last is before the first for
    none.
    """
    span = wp.vec2(float(x0), float(x1))
    span = narrow(run[0], r[0], centre, span)
    span = narrow(run[1], r[1], centre, span)
    span = narrow(run[2], r[2], centre, span)
    if span[0] > span[1]:
        return wp.vec2i(0, -1)
    return wp.vec2i(int(wp.ceil(span[0])), int(span[1]))


@wp.func
def walk(
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
    """Writes the pixels of a triangle inside x0..x1, y0..y1 into the z-buffer."""
    centre = view.cx + float(view.margin)
    run = runs_of(view, s, x0, x1)
    for y in range(y0, y1 + 1):
        r = row_share(view, s, y)
        span = columns_of(run, r, centre, x0, x1)
        for x in range(span[0], span[1] + 1):
            cover(view, s, r, x, y, env, face, packed)


@wp.func
def walk_all(
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
    """Draws a triangle's pixels as `walk` does, in the way that is faster where there are few."""
    for y in range(y0, y1 + 1):
        r = row_share(view, s, y)
        for x in range(x0, x1 + 1):
            cover(view, s, r, x, y, env, face, packed)
