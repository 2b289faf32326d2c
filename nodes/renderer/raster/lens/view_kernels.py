"""Holds the camera in a kernel, and computes the ray of each of its pixels."""

import warp as wp

wp.set_module_options({"enable_backward": False})

BUNDLE = wp.constant(16)
"""Rows and columns of the pixels of a lens whose rays are held by one cone."""

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
    cones: wp.array2d(dtype=wp.vec4)
    """Of each BUNDLE x BUNDLE of these pixels the middle of the rays, and a bound on sin a + 1 - cos a for the angle a
    between it and any of them."""
    ahead: int
    """1: all rays of a lens look ahead, and four planes hold them."""
    left: float
    """Least x / z of a lens's rays that look ahead; right: the greatest."""
    right: float
    above: wp.array(dtype=float)
    """[height] least y / z in a row and all below it; below: the greatest in a row and all above it."""
    below: wp.array(dtype=float)
    lens: Lens
    cos_field: float
    sin_field: float
    """Angle about the optical axis that holds all rays of the table."""
    domain: float
    """Angle up to which the lens maps directions one to one [rad]."""
    bounded: float
    """Angle up to which `bulges` hold [rad], at most a half turn."""
    cos_bounded: float
    sin_bounded: float
    bulges: wp.array(dtype=float)
    """Bounds on the second derivative of a pixel's position by the angle along any great circle [px/rad^2]: up to 0,
    1/n, 2/n, ... of the angle `bounded` off the axis."""


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
def pixel_width(view: CameraView, x: int, y: int, depth: float):
    """Computes the width of a pixel [m] on what faces the camera, at a depth [m] along its ray d."""
    across, down = ray_steps(view, x, y)
    return depth * wp.max(wp.length(across), wp.length(down))


@wp.func
def tile_pixel(view: CameraView, tile: int, lane: int):
    """Gives the row and column of a thread's pixel where 32 threads do 8 x 4 of them; some may lie outside the
    image."""
    across = (view.width + 7) // 8
    return tile // across * 4 + lane // 8, tile % across * 8 + lane % 8
