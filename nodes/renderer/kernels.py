"""Visibility by z-buffer: triangles to packed depth and triangle index.

Everything is camera-relative (x right, y down, z forward). A pixel's ray is d = ((x - cx) / fx, (y - cy) / fy, 1), so a
point on it is z d. Coverage is tested in homogeneous form (Olano and Greer, Triangle Scan Conversion using 2D
Homogeneous Coordinates, 1997): pixel d lies in triangle a b c when (a x b) . d, (b x c) . d and (c x a) . d have one
sign. That is the ray test itself, so a triangle that reaches behind the camera needs no new vertices; only its bounds
are clipped at the near plane. Edges are moved outwards by the rounding of the test, so a pixel centre on an edge or a
vertex belongs to all its triangles and is never missed by all.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

MISS = wp.constant(-1)
"""Triangle index of a pixel that sees no triangle."""

SPLIT_AREA = wp.constant(512)
"""Bounding box [px] above which a triangle is split among threads."""

TILE = wp.constant(8)
"""Side [px] of the piece of a split triangle that one thread walks."""


@wp.struct
class View:
    """Pinhole camera and image size; width and height include the margin, cx and cy do not."""

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


@wp.struct
class Setup:
    """A triangle ready to be walked: edge normals signed so that inside is >= -slack, plane, depth range, bounds."""

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
def pixel_ray(view: View, x: int, y: int):
    return wp.vec3(
        (float(x - view.margin) - view.cx) / view.fx,
        (float(y - view.margin) - view.cy) / view.fy,
        1.0,
    )


@wp.func
def triangle_of(packed: wp.uint64):
    return int(wp.uint32(packed & wp.uint64(0xFFFFFFFF)))


@wp.func
def depth_of(packed: wp.uint64):
    return wp.cast(wp.uint32(packed >> wp.uint64(32)), wp.float32)


@wp.func
def edge_normal(a: wp.vec3, b: wp.vec3):
    """a x b, as a x (b - a) to keep the digits of a short edge."""
    return wp.cross(a, b - a)


@wp.func
def edge_slack(view: View, a: wp.vec3, b: wp.vec3):
    """Bound of the rounding of edge_normal(a, b) . d over the image; it widens a triangle by some 1e-4 px."""
    return 6.0e-7 * wp.length(a) * wp.length(b - a) * view.reach


@wp.func
def grow(view: View, box: wp.vec4, p: wp.vec3, slack: float):
    """Image bounds (x min, x max, y min, y max) with the projection of p, kept inside what an int can hold."""
    m = float(view.margin)
    x = view.fx * p[0] / p[2] + view.cx + m
    y = view.fy * p[1] / p[2] + view.cy + m
    w = float(view.width)
    h = float(view.height)
    return wp.vec4(
        wp.min(box[0], wp.clamp(x - slack, -1.0, w)),
        wp.max(box[1], wp.clamp(x + slack, -1.0, w)),
        wp.min(box[2], wp.clamp(y - slack, -1.0, h)),
        wp.max(box[3], wp.clamp(y + slack, -1.0, h)),
    )


@wp.func
def grow_crossing(view: View, box: wp.vec4, a: wp.vec3, b: wp.vec3):
    """Bounds with the point where the edge a b meets the near plane, if it does; the slack covers its rounding."""
    if (a[2] >= view.near) == (b[2] >= view.near):
        return box
    q = a + (view.near - a[2]) / (b[2] - a[2]) * (b - a)
    slack = 1.0 + 1.0e-6 * wp.max(wp.length(a), wp.length(b)) * wp.max(view.fx, view.fy) / view.near
    return grow(view, box, wp.vec3(q[0], q[1], view.near), slack)


@wp.func
def set_up(view: View, a: wp.vec3, b: wp.vec3, c: wp.vec3, two_sided: int):
    """x1 < x0 where nothing is to be seen: behind, outside, facing away, or edge-on."""
    s = Setup()
    s.x0 = 0
    s.x1 = -1
    z_min = wp.min(a[2], wp.min(b[2], c[2]))
    z_max = wp.max(a[2], wp.max(b[2], c[2]))
    if z_max < view.near:
        return s
    normal = wp.cross(b - a, c - a)
    offset = wp.dot(normal, a)
    if offset == 0.0 or (offset > 0.0 and two_sided == 0):
        return s
    big = 1.0e9
    box = wp.vec4(big, -big, big, -big)
    if a[2] >= view.near:
        box = grow(view, box, a, 0.01)
    if b[2] >= view.near:
        box = grow(view, box, b, 0.01)
    if c[2] >= view.near:
        box = grow(view, box, c, 0.01)
    if z_min < view.near:
        box = grow_crossing(view, box, a, b)
        box = grow_crossing(view, box, b, c)
        box = grow_crossing(view, box, c, a)
    s.x0 = wp.max(int(wp.ceil(box[0])), 0)
    s.x1 = wp.min(int(wp.floor(box[1])), view.width - 1)
    s.y0 = wp.max(int(wp.ceil(box[2])), 0)
    s.y1 = wp.min(int(wp.floor(box[3])), view.height - 1)
    if s.x1 < s.x0 or s.y1 < s.y0:
        return s
    sign = wp.where(offset > 0.0, 1.0, -1.0)
    s.e0 = sign * edge_normal(b, c)
    s.e1 = sign * edge_normal(c, a)
    s.e2 = sign * edge_normal(a, b)
    s.slack = wp.vec3(edge_slack(view, b, c), edge_slack(view, c, a), edge_slack(view, a, b))
    s.normal = normal
    s.offset = offset
    s.z_min = wp.max(z_min, view.near)
    s.z_max = z_max
    return s


@wp.func
def narrow(view: View, edge: wp.vec3, row: float, span: wp.vec2):
    """The columns of a row that an edge may leave, one pixel more than exact; an edge along the row leaves all."""
    if wp.abs(edge[0]) <= 1.0e-5 * (wp.abs(edge[1]) + wp.abs(edge[2])):
        return span
    x = view.cx + float(view.margin) - row / edge[0] * view.fx
    if edge[0] > 0.0:
        return wp.vec2(wp.max(span[0], x - 1.0), span[1])
    return wp.vec2(span[0], wp.min(span[1], x + 1.0))


@wp.func
def walk(
    view: View,
    s: Setup,
    x0: int,
    x1: int,
    y0: int,
    y1: int,
    env: int,
    triangle: int,
    packed: wp.array3d(dtype=wp.uint64),
):
    """Write the pixels of a triangle inside x0..x1, y0..y1 into the z-buffer."""
    low = wp.uint64(triangle)
    for y in range(y0, y1 + 1):
        dy = (float(y - view.margin) - view.cy) / view.fy
        r0 = s.e0[1] * dy + s.e0[2] + s.slack[0]
        r1 = s.e1[1] * dy + s.e1[2] + s.slack[1]
        r2 = s.e2[1] * dy + s.e2[2] + s.slack[2]
        rn = s.normal[1] * dy + s.normal[2]
        span = wp.vec2(float(x0), float(x1))
        span = narrow(view, s.e0, r0, span)
        span = narrow(view, s.e1, r1, span)
        span = narrow(view, s.e2, r2, span)
        if span[0] <= span[1]:
            for x in range(int(wp.ceil(span[0])), int(span[1]) + 1):
                dx = (float(x - view.margin) - view.cx) / view.fx
                if s.e0[0] * dx + r0 >= 0.0 and s.e1[0] * dx + r1 >= 0.0 and s.e2[0] * dx + r2 >= 0.0:
                    z = s.offset / (s.normal[0] * dx + rn)
                    # The depth range bounds what rounding can do to a triangle seen almost edge-on.
                    if z >= view.near:
                        z = wp.clamp(z, s.z_min, s.z_max)
                        bits = wp.uint64(wp.cast(z, wp.uint32)) << wp.uint64(32)
                        wp.atomic_min(packed, env, y, x, bits | low)


@wp.kernel
def to_camera(
    # in
    points: wp.array(dtype=wp.vec3),
    instance: wp.array(dtype=int),
    rotation: wp.array2d(dtype=wp.mat33),
    translation: wp.array2d(dtype=wp.vec3),
    # out
    vertices: wp.array2d(dtype=wp.vec3),
):
    env, v = wp.tid()
    i = instance[v]
    vertices[env, v] = rotation[env, i] * points[v] + translation[env, i]


def make_raster(split: bool) -> wp.Kernel:
    """One thread per triangle, rows row0..row1 - 1. split: those above SPLIT_AREA go to a list for `raster_tiles`."""

    @wp.kernel(module="unique", enable_backward=False)
    def raster(
        # in
        view: View,
        row0: int,
        row1: int,
        vertices: wp.array2d(dtype=wp.vec3),
        triangles: wp.array(dtype=wp.vec3i),
        instance: wp.array(dtype=int),
        two_sided: wp.array(dtype=int),
        # out
        packed: wp.array3d(dtype=wp.uint64),
        counter: wp.array(dtype=wp.uint64),
        large: wp.array(dtype=wp.vec2i),
        large_start: wp.array(dtype=wp.int64),
    ):
        env, t = wp.tid()
        k = triangles[t]
        s = set_up(view, vertices[env, k[0]], vertices[env, k[1]], vertices[env, k[2]], two_sided[instance[t]])
        y0 = wp.max(s.y0, row0)
        y1 = wp.min(s.y1, row1 - 1)
        if s.x1 >= s.x0 and y1 >= y0:
            if wp.static(split):
                if (s.x1 - s.x0 + 1) * (y1 - y0 + 1) > SPLIT_AREA:
                    tiles = ((s.x1 - s.x0) // TILE + 1) * ((s.y1 - s.y0) // TILE + 1)
                    # One 64-bit counter gives a place in the list and the number of tiles before it at once.
                    old = wp.atomic_add(counter, 0, (wp.uint64(1) << wp.uint64(40)) | wp.uint64(tiles))
                    place = int(old >> wp.uint64(40))
                    large[place] = wp.vec2i(env, t)
                    large_start[place] = wp.int64(old & wp.uint64(0xFFFFFFFFFF))
                    return
            walk(view, s, s.x0, s.x1, y0, y1, env, t, packed)

    return raster


@wp.kernel
def raster_tiles(
    # in
    view: View,
    workers: int,
    vertices: wp.array2d(dtype=wp.vec3),
    triangles: wp.array(dtype=wp.vec3i),
    counter: wp.array(dtype=wp.uint64),
    large: wp.array(dtype=wp.vec2i),
    large_start: wp.array(dtype=wp.int64),
    # out
    packed: wp.array3d(dtype=wp.uint64),
):
    worker = wp.tid()
    count = int(counter[0] >> wp.uint64(40))
    total = wp.int64(counter[0] & wp.uint64(0xFFFFFFFFFF))
    tile = wp.int64(worker)
    while tile < total:
        low = wp.int32(0)
        high = int(count)
        while high - low > 1:
            middle = (low + high) // 2
            if large_start[middle] <= tile:
                low = middle
            else:
                high = middle
        env = large[low][0]
        t = large[low][1]
        k = triangles[t]
        s = set_up(view, vertices[env, k[0]], vertices[env, k[1]], vertices[env, k[2]], 1)
        columns = (s.x1 - s.x0) // TILE + 1
        index = int(tile - large_start[low])
        x0 = s.x0 + index % columns * TILE
        y0 = s.y0 + index // columns * TILE
        walk(view, s, x0, wp.min(x0 + TILE - 1, s.x1), y0, wp.min(y0 + TILE - 1, s.y1), env, t, packed)
        tile += wp.int64(workers)
