"""Visibility by z-buffer: one triangle to packed depth and triangle index. The kernels are in raster_kernels.py.

Everything is camera-relative (x right, y down, z forward). A pixel's ray is d = ((x - cx) / fx, (y - cy) / fy, 1), so a
point on it is z d; through a distorting lens d is a unit vector from a table, and the point is its distance times d.
Coverage is tested in homogeneous form (Olano and Greer, Triangle Scan Conversion using 2D Homogeneous Coordinates,
1997): pixel d lies in triangle a b c when (a x b) . d, (b x c) . d and (c x a) . d have one sign. That is the ray test
itself, so it is as exact through a lens, and a triangle that reaches behind the camera needs no new vertices; only its
bounds are clipped at the near plane. Edges are moved outwards by the rounding of the test, so a pixel centre on an edge
or a vertex belongs to all its triangles and is never missed by all.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

MISS = wp.constant(-1)
"""Triangle index of a pixel that sees no triangle."""

NARROW = wp.constant(6)
"""Columns from which on each row of a triangle is narrowed to what its edges leave."""

Lens = wp.types.vector(length=8, dtype=wp.float64)
"""Distortion coefficients, in the order of evis.geometry.distortion, padded with zeros."""


@wp.struct
class CameraView:
    """Holds camera and image size; width and height include the margin, cx and cy do not."""

    fx: float
    fy: float
    cx: float
    cy: float
    near: float
    reach: float
    """Length of the longest ray d of the image."""
    width: int
    height: int
    margin: int
    distorted: int
    """1: rays come from the table, `near` is a distance from the camera, and `lens` bends directions."""
    local: int
    """1: vertices are [1, V] in the frames of their instances; 0: [E, V] in the camera's, of what may be seen."""
    columns: wp.array(dtype=float)
    rows: wp.array(dtype=float)
    """x of a pinhole's rays in every column and y in every row: loaded sooner than divided for; empty for a lens."""
    rays: wp.array2d(dtype=wp.vec3)
    """[height, width] unit rays, 0 where the lens sees nothing; empty for a pinhole."""
    lens: Lens
    cos_field: float
    sin_field: float
    """Angle about the optical axis that holds all rays of the table."""
    domain: float
    """Angle up to which the lens maps directions one to one [rad]."""
    bounded: float
    """Angle up to which `bulge` holds [rad]."""
    bulge: float
    """Bound on the second derivative of a pixel's position by the angle along any great circle [px/rad^2]."""


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


@wp.func
def pixel_ray(view: CameraView, x: int, y: int):
    """Gives the ray d of a pixel; the branch goes one way for a whole launch and costs nothing that could be
    measured."""
    if view.distorted == 1:
        return view.rays[y, x]
    return wp.vec3(view.columns[x], view.rows[y], 1.0)


@wp.func
def ray_steps(view: CameraView, x: int, y: int):
    """Finds how the ray d of a pixel changes from one column and one row to the next."""
    if view.distorted == 1:
        left = wp.max(x - 1, 0)
        right = wp.min(x + 1, view.width - 1)
        above = wp.max(y - 1, 0)
        below = wp.min(y + 1, view.height - 1)
        across = (view.rays[y, right] - view.rays[y, left]) / float(wp.max(right - left, 1))
        return across, (view.rays[below, x] - view.rays[above, x]) / float(wp.max(below - above, 1))
    return wp.vec3(1.0 / view.fx, 0.0, 0.0), wp.vec3(0.0, 1.0 / view.fy, 0.0)


@wp.func
def tile_pixel(view: CameraView, tile: int, lane: int):
    """Gives the row and column of a thread's pixel where 32 threads do 8 x 4 of them; some may lie outside the
    image."""
    across = (view.width + 7) // 8
    return tile // across * 4 + lane // 8, tile % across * 8 + lane % 8


@wp.func
def triangle_of(packed: wp.uint64):
    """Unpacks the triangle of a z-buffer entry, or MISS."""
    return int(wp.uint32(packed & wp.uint64(0xFFFFFFFF)))


@wp.func
def depth_of(packed: wp.uint64):
    """Unpacks the depth of a z-buffer entry [m]."""
    return wp.cast(wp.uint32(packed >> wp.uint64(32)), wp.float32)


@wp.func
def corner(view: CameraView, vertices: wp.array2d(dtype=wp.vec3), turn: wp.mat33, place: wp.vec3, env: int, k: int):
    """Gives vertex k in the camera frame; turn, place: the pose of the instance that it belongs to."""
    if view.local == 1:
        return turn * vertices[0, k] + place
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
    k = triangles[t]
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
def grow(view: CameraView, box: wp.vec4, p: wp.vec3, slack: float):
    """Gives the image bounds (x min, x max, y min, y max) with the projection of p, kept inside what an int can
    hold."""
    m = float(view.margin)
    nearness = 1.0 / p[2]
    x = view.fx * p[0] * nearness + view.cx + m
    y = view.fy * p[1] * nearness + view.cy + m
    w = float(view.width)
    h = float(view.height)
    return wp.vec4(
        wp.min(box[0], wp.clamp(x - slack, -1.0, w)),
        wp.max(box[1], wp.clamp(x + slack, -1.0, w)),
        wp.min(box[2], wp.clamp(y - slack, -1.0, h)),
        wp.max(box[3], wp.clamp(y + slack, -1.0, h)),
    )


@wp.func
def grow_crossing(view: CameraView, box: wp.vec4, a: wp.vec3, b: wp.vec3):
    """Bounds with the point where the edge a b meets the near plane, if it does; the slack covers its rounding."""
    if (a[2] >= view.near) == (b[2] >= view.near):
        return box
    q = a + (view.near - a[2]) / (b[2] - a[2]) * (b - a)
    slack = 1.0 + 1.0e-6 * wp.max(wp.length(a), wp.length(b)) * wp.max(view.fx, view.fy) / view.near
    return grow(view, box, wp.vec3(q[0], q[1], view.near), slack)


@wp.func
def beyond(slope: float, across: float, z: float, radius: float):
    """Tells whether a sphere lies wholly on the far side of the plane across = slope z through the camera."""
    return across - slope * z > radius * wp.sqrt(1.0 + slope * slope)


@wp.func
def outside(view: CameraView, row0: int, row1: int, c: wp.vec3, radius: float):
    """Tells whether a sphere about c covers no pixel centre of rows row0..row1 - 1; the sphere is widened by its
    rounding."""
    r = radius + 1.0e-5 * (wp.length(c) + radius)
    if view.distorted == 1:
        # Distance from the cone about the optical axis that holds every ray.
        return wp.sqrt(c[0] * c[0] + c[1] * c[1]) * view.cos_field - c[2] * view.sin_field > r
    if c[2] + r < view.near:
        return True
    m = float(view.margin)
    # One pixel more than the outermost centres, for triangles are widened by less.
    left = (-1.0 - m - view.cx) / view.fx
    right = (float(view.width) - m - view.cx) / view.fx
    top = (float(row0) - 1.0 - m - view.cy) / view.fy
    bottom = (float(row1) - m - view.cy) / view.fy
    return (
        beyond(right, c[0], c[2], r)
        or beyond(-left, -c[0], c[2], r)
        or beyond(bottom, c[1], c[2], r)
        or beyond(-top, -c[1], c[2], r)
    )


@wp.func
def turned_away(axis: wp.vec3, cosine: float, c: wp.vec3, radius: float):
    """Tells whether every triangle in a sphere about c with normals in a cone shows its back to the camera."""
    if cosine <= 0.0:
        return False
    along = wp.dot(axis, c)
    across = wp.sqrt(wp.max(wp.dot(c, c) - along * along, 0.0))
    sine = wp.sqrt(wp.max(1.0 - cosine * cosine, 0.0))
    return along * cosine - across * sine > radius + 1.0e-4 * (wp.length(c) + radius)


@wp.func
def facing(a: wp.vec3, b: wp.vec3, c: wp.vec3, two_sided: int):
    """False for a triangle that is edge-on, or shows its back without having one."""
    offset = wp.dot(wp.cross(b - a, c - a), a)
    return offset < 0.0 or (offset > 0.0 and two_sided == 1)


@wp.func
def bounds(view: CameraView, a: wp.vec3, b: wp.vec3, c: wp.vec3):
    """Gives what of the image a triangle before the near plane may cover: (x min, x max, y min, y max)."""
    big = 1.0e9
    box = wp.vec4(big, -big, big, -big)
    if a[2] >= view.near:
        box = grow(view, box, a, 0.01)
    if b[2] >= view.near:
        box = grow(view, box, b, 0.01)
    if c[2] >= view.near:
        box = grow(view, box, c, 0.01)
    if wp.min(a[2], wp.min(b[2], c[2])) < view.near:
        box = grow_crossing(view, box, a, b)
        box = grow_crossing(view, box, b, c)
        box = grow_crossing(view, box, c, a)
    return box


@wp.func
def holds_pixel(view: CameraView, box: wp.vec4):
    """Tells whether any pixel centre of the image lies in these bounds."""
    wide = wp.max(wp.ceil(box[0]), 0.0) <= wp.min(wp.floor(box[1]), float(view.width - 1))
    return wide and wp.max(wp.ceil(box[2]), 0.0) <= wp.min(wp.floor(box[3]), float(view.height - 1))


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
    triangle: int,
    packed: wp.array3d(dtype=wp.uint64),
):
    """Writes a pixel of a triangle into the z-buffer if it covers it; r: the row's share of edges and plane."""
    dx = view.columns[x]
    if s.e0[0] * dx + r[0] >= 0.0 and s.e1[0] * dx + r[1] >= 0.0 and s.e2[0] * dx + r[2] >= 0.0:
        z = s.offset / (s.normal[0] * dx + r[3])
        # The depth range bounds what rounding can do to a triangle seen almost edge-on.
        if z >= view.near:
            z = wp.clamp(z, s.z_min, s.z_max)
            bits = wp.uint64(wp.cast(z, wp.uint32)) << wp.uint64(32)
            wp.atomic_min(packed, env, y, x, bits | wp.uint64(triangle))


@wp.func
def row_share(view: CameraView, s: Setup, y: int):
    """Gives what of the edge functions and the plane's is the same for a row of pixels."""
    dy = view.rows[y]
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
    triangle: int,
    packed: wp.array3d(dtype=wp.uint64),
):
    """Writes the pixels of a triangle inside x0..x1, y0..y1 into the z-buffer."""
    centre = view.cx + float(view.margin)
    run = runs_of(view, s, x0, x1)
    for y in range(y0, y1 + 1):
        r = row_share(view, s, y)
        span = columns_of(run, r, centre, x0, x1)
        for x in range(span[0], span[1] + 1):
            cover(view, s, r, x, y, env, triangle, packed)


@wp.func
def walk_all(
    view: CameraView,
    s: Setup,
    x0: int,
    x1: int,
    y0: int,
    y1: int,
    env: int,
    triangle: int,
    packed: wp.array3d(dtype=wp.uint64),
):
    """Does the same where there are few pixels."""
    for y in range(y0, y1 + 1):
        r = row_share(view, s, y)
        for x in range(x0, x1 + 1):
            cover(view, s, r, x, y, env, triangle, packed)
