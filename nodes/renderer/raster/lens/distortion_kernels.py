"""Computes a lens in a kernel: where a direction is seen, what of the image a triangle may cover, and its pixels by
table rays.

The formulas are those of evis.geometry.distortion. Positions are computed in float64, for motion is a difference of two
of them, and float32 pixels would leave 1e-4 px.
"""

from functools import cache

import warp as wp

from nodes.renderer.raster.bounds_kernels import outside
from nodes.renderer.raster.depth_kernels import put_depth
from nodes.renderer.raster.lens.view_kernels import BUNDLE, CameraView
from nodes.renderer.raster.triangle_kernels import Setup

wp.set_module_options({"enable_backward": False})


@cache
def make_distorted(lens: str) -> wp.Function:
    """Makes the wp.func (view, point) -> pixel [px] without margin, float64, for `plumb_bob` or `equidistant`."""

    @wp.func
    def plumb_bob(view: CameraView, p: wp.vec3d):
        """Computes the pixel of a direction through a lens of OpenCV's plumb-bob model."""
        x = p[0] / p[2]
        y = p[1] / p[2]
        k = view.lens
        one = wp.float64(1.0)
        two = wp.float64(2.0)
        s = x * x + y * y
        ratio = (one + s * (k[0] + s * (k[1] + s * k[4]))) / (one + s * (k[5] + s * (k[6] + s * k[7])))
        u = x * ratio + two * k[2] * x * y + k[3] * (s + two * x * x)
        v = y * ratio + k[2] * (s + two * y * y) + two * k[3] * x * y
        return wp.vec2d(
            wp.float64(view.fx) * u + wp.float64(view.cx),
            wp.float64(view.fy) * v + wp.float64(view.cy),
        )

    @wp.func
    def equidistant(view: CameraView, p: wp.vec3d):
        """Computes the pixel of a direction through a lens of the equidistant (fisheye) model."""
        x = p[0]
        y = p[1]
        r = wp.sqrt(x * x + y * y)
        theta = wp.atan2(r, p[2])
        k = view.lens
        s = theta * theta
        bent = theta * (wp.float64(1.0) + s * (k[0] + s * (k[1] + s * (k[2] + s * k[3]))))
        ratio = wp.float64(0.0)
        if r > wp.float64(0.0):
            ratio = bent / r
        return wp.vec2d(
            wp.float64(view.fx) * x * ratio + wp.float64(view.cx),
            wp.float64(view.fy) * y * ratio + wp.float64(view.cy),
        )

    return plumb_bob if lens == "plumb_bob" else equidistant


@wp.func
def angle_of(p: wp.vec3d):
    """Gives the angle to the optical axis [rad]."""
    return wp.atan2(wp.sqrt(p[0] * p[0] + p[1] * p[1]), p[2])


@wp.func
def in_bounds(view: CameraView, p: wp.vec3):
    """Tells whether `bulges` hold for this direction."""
    # The angle to the axis is less than that one where the sine of their difference is negative.
    return wp.sqrt(p[0] * p[0] + p[1] * p[1]) * view.cos_bounded < p[2] * view.sin_bounded


@wp.func
def bulge_of(view: CameraView, cosine: float):
    """Gives the one of `bulges` for edges whose ends are no farther off the axis than an angle with this cosine: where
    both look ahead no point between them is farther off."""
    last = view.bulges.shape[0] - 1
    if cosine <= 0.0:
        return view.bulges[last]
    return view.bulges[wp.min(int(wp.acos(wp.min(cosine, 1.0)) / view.bounded * float(last)) + 1, last)]


@wp.func
def beside(slope: float, x: float, y: float, a: wp.vec3, b: wp.vec3, c: wp.vec3):
    """Tells whether a triangle lies wholly on the far side of the plane x p[0] + y p[1] = slope p[2]."""
    normal = wp.vec3(x, y, -slope)
    return wp.dot(normal, a) > 0.0 and wp.dot(normal, b) > 0.0 and wp.dot(normal, c) > 0.0


@cache
def make_bounds(lens: str) -> wp.Function:
    """Makes the wp.func (view, a, b, c) -> (x min, x max, y min, y max): what of the image a triangle may cover.

    An edge of angle alpha strays from the chord between its ends by at most bulge alpha^2 / 8, where bulge is that of
    its end that is farther off the axis. A triangle that reaches
    far beyond the field of view may cover all of the image.
    """
    distorted = make_distorted(lens)

    @wp.func
    def bounds_through_lens(view: CameraView, a: wp.vec3, b: wp.vec3, c: wp.vec3):
        """Bounds what of the image a triangle may cover through a lens."""
        w = float(view.width)
        h = float(view.height)
        if view.ahead == 1:
            last = view.height - 1
            wide = beside(view.right, 1.0, 0.0, a, b, c) or beside(-view.left, -1.0, 0.0, a, b, c)
            if wide or beside(view.below[last], 0.0, 1.0, a, b, c) or beside(-view.above[0], 0.0, -1.0, a, b, c):
                return wp.vec4(0.0, -1.0, 0.0, -1.0)
        least = 1.0e-3 * wp.max(wp.length(a), wp.max(wp.length(b), wp.length(c)))
        good = wp.min(a[2], wp.min(b[2], c[2])) > least
        if not (good and in_bounds(view, a) and in_bounds(view, b) and in_bounds(view, c)):
            m = (a + b + c) / 3.0
            if outside(view, 0, view.height, m, wp.max(wp.length(a - m), wp.max(wp.length(b - m), wp.length(c - m)))):
                return wp.vec4(0.0, -1.0, 0.0, -1.0)
            return wp.vec4(0.0, w, 0.0, h)
        ua = wp.normalize(a)
        ub = wp.normalize(b)
        uc = wp.normalize(c)
        # At least the angle 2 asin(chord / 2) of two directions, and hardly more where that is small.
        chord = wp.max(wp.length(ub - ua), wp.max(wp.length(uc - ub), wp.length(ua - uc)))
        angle = chord * (1.0 + 0.15 * chord * chord)
        slack = 0.01 + 0.125 * bulge_of(view, wp.min(ua[2], wp.min(ub[2], uc[2]))) * angle * angle
        pa = distorted(view, wp.vec3d(a))
        pb = distorted(view, wp.vec3d(b))
        pc = distorted(view, wp.vec3d(c))
        margin = float(view.margin)
        x0 = float(wp.min(pa[0], wp.min(pb[0], pc[0]))) + margin - slack
        x1 = float(wp.max(pa[0], wp.max(pb[0], pc[0]))) + margin + slack
        y0 = float(wp.min(pa[1], wp.min(pb[1], pc[1]))) + margin - slack
        y1 = float(wp.max(pa[1], wp.max(pb[1], pc[1]))) + margin + slack
        return wp.vec4(
            wp.clamp(x0, -1.0, w), wp.clamp(x1, -1.0, w), wp.clamp(y0, -1.0, h), wp.clamp(y1, -1.0, h)
        )  # fmt: skip

    return bounds_through_lens


@wp.func
def walk_bundle(
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
    """Writes the same pixels as `walk_rays`, one after the other."""
    for y in range(y0, y1 + 1):
        for x in range(x0, x1 + 1):
            d = view.rays[y, x]
            if wp.dot(s.e0, d) + s.slack[0] >= 0.0 and wp.dot(s.e1, d) + s.slack[1] >= 0.0:
                if wp.dot(s.e2, d) + s.slack[2] >= 0.0:
                    along = wp.dot(s.normal, d)
                    if along != 0.0:
                        z = s.offset / along
                        if z >= view.near:
                            put_depth(packed, env, y, x, wp.clamp(z, s.z_min, s.z_max), face)


@wp.func
def reached(edge: wp.vec3, slack: float, length: float, cone: wp.vec4):
    """Tells whether any ray of a cone may lie on the inner side of an edge; length: of `edge`."""
    return edge[0] * cone[0] + edge[1] * cone[1] + edge[2] * cone[2] + length * cone[3] + slack >= 0.0


@wp.func
def walk_rays(
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
    """Writes the same pixels as `walk` by the rays of the table: distance along the ray in place of depth.

    Of a triangle's bounds, which are wide where it reaches beyond the field of view, bundles of rays are left out that
    lie beyond one of its edges.
    """
    if x1 - x0 < BUNDLE:
        walk_bundle(view, s, x0, x1, y0, y1, env, face, packed)
    else:
        l0 = wp.length(s.e0)
        l1 = wp.length(s.e1)
        l2 = wp.length(s.e2)
        for v in range(y0 // BUNDLE, y1 // BUNDLE + 1):
            top = wp.max(v * BUNDLE, y0)
            bottom = wp.min(v * BUNDLE + BUNDLE - 1, y1)
            for u in range(x0 // BUNDLE, x1 // BUNDLE + 1):
                cone = view.cones[v, u]
                if reached(s.e0, s.slack[0], l0, cone) and reached(s.e1, s.slack[1], l1, cone):
                    if reached(s.e2, s.slack[2], l2, cone):
                        left = wp.max(u * BUNDLE, x0)
                        right = wp.min(u * BUNDLE + BUNDLE - 1, x1)
                        walk_bundle(view, s, left, right, top, bottom, env, face, packed)
