"""Bounds what of the image a triangle or a sphere may cover, and finds what shows the camera its back."""

import warp as wp

from nodes.renderer.raster.lens.view_kernels import CameraView

wp.set_module_options({"enable_backward": False})


SLACK = wp.constant(0.01)
"""How far bounds are beyond the corners [px]: more than these are rounded by, and than a triangle is widened by."""


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
    """Widens bounds by the point where the edge a b meets the near plane, if it does; the slack covers its rounding."""
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
        if wp.sqrt(c[0] * c[0] + c[1] * c[1]) * view.cos_field - c[2] * view.sin_field > r:
            return True
        if view.ahead == 0:
            return False
        return (
            beyond(view.right, c[0], c[2], r)
            or beyond(-view.left, -c[0], c[2], r)
            or beyond(view.below[row1 - 1], c[1], c[2], r)
            or beyond(-view.above[row0], -c[1], c[2], r)
        )
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
    """Tells whether a triangle shows its front or, if two-sided, its back; not so where it is edge-on."""
    offset = wp.dot(wp.cross(b - a, c - a), a)
    return offset < 0.0 or (offset > 0.0 and two_sided == 1)


@wp.func
def bounds_ahead(view: CameraView, a: wp.vec3, b: wp.vec3, c: wp.vec3):
    """Gives the same as `bounds` of a triangle all of which is beyond the near plane."""
    near_a = 1.0 / a[2]
    near_b = 1.0 / b[2]
    near_c = 1.0 / c[2]
    left = wp.min(a[0] * near_a, wp.min(b[0] * near_b, c[0] * near_c))
    right = wp.max(a[0] * near_a, wp.max(b[0] * near_b, c[0] * near_c))
    top = wp.min(a[1] * near_a, wp.min(b[1] * near_b, c[1] * near_c))
    bottom = wp.max(a[1] * near_a, wp.max(b[1] * near_b, c[1] * near_c))
    x = view.cx + float(view.margin)
    y = view.cy + float(view.margin)
    w = float(view.width)
    h = float(view.height)
    return wp.vec4(
        wp.clamp(view.fx * left + (x - SLACK), -1.0, w),
        wp.clamp(view.fx * right + (x + SLACK), -1.0, w),
        wp.clamp(view.fy * top + (y - SLACK), -1.0, h),
        wp.clamp(view.fy * bottom + (y + SLACK), -1.0, h),
    )


@wp.func
def bounds(view: CameraView, a: wp.vec3, b: wp.vec3, c: wp.vec3):
    """Gives what of the image a triangle before the near plane may cover: (x min, x max, y min, y max)."""
    if wp.min(a[2], wp.min(b[2], c[2])) >= view.near:
        return bounds_ahead(view, a, b, c)
    big = 1.0e9
    box = wp.vec4(big, -big, big, -big)
    if a[2] >= view.near:
        box = grow(view, box, a, SLACK)
    if b[2] >= view.near:
        box = grow(view, box, b, SLACK)
    if c[2] >= view.near:
        box = grow(view, box, c, SLACK)
    box = grow_crossing(view, box, a, b)
    box = grow_crossing(view, box, b, c)
    return grow_crossing(view, box, c, a)


@wp.func
def holds_pixel(view: CameraView, box: wp.vec4):
    """Tells whether any pixel centre of the image lies in these bounds."""
    wide = wp.max(wp.ceil(box[0]), 0.0) <= wp.min(wp.floor(box[1]), float(view.width - 1))
    return wide and wp.max(wp.ceil(box[2]), 0.0) <= wp.min(wp.floor(box[3]), float(view.height - 1))
