"""Who may be between a spot light and a point: looked up in a grid over what the light sees, for shadow rays.

Seen from the light, all of a ray lies in one cell of the grid. For every cell there is a list of the still instances
whose boxes it holds anything of (a light buffer: Haines and Greenberg, The Light Buffer, 1986), and a bit for each
moving one. Only these are tried, in place of the nodes of a tree; whom a ray meets is decided by the same test, so the
shadows are the same.
"""

import warp as wp

from nodes.renderer.shadows.ray_kernels import LIFT, Casters, in_the_way

wp.set_module_options({"enable_backward": False})

SIDE = wp.constant(128)
"""Cells across the grid over still instances."""
COARSE = wp.constant(32)
"""Cells across the grid over moving ones."""
MOVERS = wp.constant(64)
"""Bits of a cell."""
BEFORE = wp.constant(0.02)
"""Distance ahead of the light [m] from which on cells are looked up; what comes nearer may be anywhere."""
EVERYBODY = wp.constant(1.0e30)
"""Distance ahead [m] that stands for one at which all are tried."""


@wp.struct
class Grid:
    """Holds which casters may lie in the cone of each of the lights [G], by cells of its field of view.

    In a frame with the world's axes: place, unit vectors to the right, down and ahead; scale: 1 / tan of the cone's
    half angle. turn, shift [E]: camera to that frame; pad [E]: rounding of a place in it [m]. cells [G SIDE^2 + 2]:
    where the entries of each cell begin; the last one has all still instances. entries: index into casters.order, and
    the bits of the least distance ahead of the light, ascending. lower, upper [still]: boxes, wider by `slack` [m] or
    more. masks [E, G, COARSE^2]: bits of casters.order[still ...].
    """

    place: wp.array(dtype=wp.vec3)
    right: wp.array(dtype=wp.vec3)
    down: wp.array(dtype=wp.vec3)
    ahead: wp.array(dtype=wp.vec3)
    scale: wp.array(dtype=float)
    turn: wp.array(dtype=wp.mat33)
    shift: wp.array(dtype=wp.vec3)
    pad: wp.array(dtype=float)
    cells: wp.array(dtype=int)
    entries: wp.array(dtype=wp.vec2i)
    lower: wp.array(dtype=wp.vec3)
    upper: wp.array(dtype=wp.vec3)
    slack: float
    masks: wp.array3d(dtype=wp.uint64)


LOWEST = """
#if defined(__CUDA_ARCH__)
    return __ffsll((long long)bits) - 1;
#else
    int n = 0;
    for (unsigned long long rest = bits; !(rest & 1ull); rest >>= 1)
        n++;
    return n;
#endif
"""


@wp.func_native(LOWEST)
def lowest(bits: wp.uint64) -> wp.int32:
    """Gives the number of the lowest bit that is set; at least one is."""
    ...


@wp.func
def meets_box(lower: wp.vec3, upper: wp.vec3, origin: wp.vec3, inverse: wp.vec3, length: float):
    """Tells whether a ray meets a box; inverse: 1 / its direction."""
    a = wp.cw_mul(lower - origin, inverse)
    b = wp.cw_mul(upper - origin, inverse)
    return wp.max(wp.max(wp.min(a, b)), 0.0) <= wp.min(wp.min(wp.max(a, b)), length)


@wp.func
def inverse_of(x: float):
    """Gives 1 / x, large where x is about 0."""
    return wp.where(wp.abs(x) < 1.0e-12, wp.where(x < 0.0, -1.0e12, 1.0e12), 1.0 / x)


@wp.func
def cell_of(grid: Grid, g: int, env: int, origin: wp.vec3, start: wp.vec3):
    """Gives the column and row [0, 1) of the cell that holds the rays from a point to light g, and how far ahead of the
    light it is [m]; EVERYBODY where none is sure to. origin, start: the point in the camera's frame and the grid's."""
    away = start - grid.place[g]
    ahead = wp.dot(away, grid.ahead[g])
    # A ray does not end at the light but as far beside it as it starts above its surface, and rounding comes to that.
    beside = LIFT * (wp.length(origin) + grid.slack) + grid.pad[env]
    if ahead > BEFORE and 4.0 * beside < grid.slack:
        half = 0.5 * grid.scale[g] / ahead
        x = wp.dot(away, grid.right[g]) * half + 0.5
        y = wp.dot(away, grid.down[g]) * half + 0.5
        if x >= 0.0 and y >= 0.0 and x < 1.0 and y < 1.0:
            return x, y, ahead
    return 0.0, 0.0, EVERYBODY


@wp.func
def hidden_from(
    casters: Casters,
    grid: Grid,
    g: int,
    env: int,
    skip: int,
    origin: wp.vec3,
    direction: wp.vec3,
    length: float,
):
    """Tells whether any caster but `skip` is between a point and light g: what `occluded` says of all casters."""
    start = grid.turn[env] * origin + grid.shift[env]
    x, y, ahead = cell_of(grid, g, env, origin, start)
    cell = grid.cells.shape[0] - 2
    movers = ~wp.uint64(0)
    if ahead < EVERYBODY:
        cell = (g * SIDE + int(y * float(SIDE))) * SIDE + int(x * float(SIDE))
        movers = grid.masks[env, g, int(y * float(COARSE)) * COARSE + int(x * float(COARSE))]
    along = grid.turn[env] * direction
    inverse = wp.vec3(inverse_of(along[0]), inverse_of(along[1]), inverse_of(along[2]))
    k = grid.cells[cell]
    end = grid.cells[cell + 1]
    moving = casters.order.shape[0] - casters.still
    # One loop for all, for a GPU's threads then try their meshes together.
    while k < end or movers != wp.uint64(0):
        n = wp.int32(-1)
        if k < end:
            entry = grid.entries[k]
            k += 1
            if wp.cast(entry[1], wp.float32) >= ahead:
                k = end
            elif meets_box(grid.lower[entry[0]], grid.upper[entry[0]], start, inverse, length):
                n = entry[0]
        else:
            bit = lowest(movers)
            movers = movers & (movers - wp.uint64(1))
            if bit < moving:
                n = casters.still + bit
        if n >= 0:
            i = casters.order[n]
            if i != skip:
                if in_the_way(casters, env, i, origin, direction, length, 0.0):
                    return True
    return False


@wp.func
def cell_range(low: float, high: float, near: float, far: float):
    """Gives the first and last cell that hold anything of low..high at distances near..far ahead, in units of the
    cone's tan."""
    a = (0.5 * wp.min(low / near, low / far) + 0.5) * float(COARSE) - 0.01
    b = (0.5 * wp.max(high / near, high / far) + 0.5) * float(COARSE) + 0.01
    first = int(wp.floor(wp.clamp(a, 0.0, float(COARSE))))
    last = int(wp.floor(wp.clamp(b, -1.0, float(COARSE - 1))))
    return first, last


@wp.kernel
def mark_movers(
    # in
    casters: Casters,
    # in and out
    grid: Grid,
):
    """Sets the bits of the moving instances in all cells that may hold anything of their spheres; all were 0."""
    env, g, n = wp.tid()
    i = casters.order[casters.still + n]
    centre = grid.turn[env] * casters.translation[env, i] + grid.shift[env] - grid.place[g]
    radius = casters.radius[i] + grid.slack
    w = wp.dot(centre, grid.ahead[g])
    if w + radius <= BEFORE:
        return
    x0 = wp.int32(0)
    y0 = wp.int32(0)
    x1 = COARSE - 1
    y1 = COARSE - 1
    if w - radius > BEFORE:
        u = wp.dot(centre, grid.right[g]) * grid.scale[g]
        v = wp.dot(centre, grid.down[g]) * grid.scale[g]
        r = radius * grid.scale[g]
        x0, x1 = cell_range(u - r, u + r, w - radius, w + radius)
        y0, y1 = cell_range(v - r, v + r, w - radius, w + radius)
    for y in range(y0, y1 + 1):
        for x in range(x0, x1 + 1):
            wp.atomic_or(grid.masks, env, g, y * COARSE + x, wp.uint64(1) << wp.uint64(n))
