"""Looks up what may be between a light without size and a point, in a grid over what the light sees, for shadow rays.

Seen from the light, all of a ray lies in one cell of a grid: of one in a plane before a spot light, of one of six on
the faces of a cube about a point light, of one across the way of a directional light. For every cell there is a list of
the still instances whose boxes it holds anything of (a light buffer: Haines and Greenberg, The Light Buffer, 1986), and
a bit for each moving one. Only these are tried, in place of the nodes of a tree; whom a ray meets is decided by the
same test, so the shadows are the same.
"""

import warp as wp

from evis.gpu.bits_kernels import lowest
from nodes.renderer.shadows.ray_kernels import LIFT, Casters, hits_box, hits_instance, inverse_of

wp.set_module_options({"enable_backward": False})

SIDE = wp.constant(128)
"""Cells across the grid over still instances."""
COARSE = wp.constant(64)
"""Cells across the grid over moving ones."""
MOVERS = wp.constant(64)
"""Bits of a cell."""
BEFORE = wp.constant(0.02)
"""Distance ahead of the light [m] from which on cells are looked up; what comes nearer may be anywhere."""
EVERYBODY = wp.constant(-1)
"""Cell that stands for all: every instance is tried."""
MOVERS_ONLY = wp.constant(-2)
"""Cell of a point past which nothing still lies on the way to a directional light."""
CUBE = wp.constant(6)
"""Grids of a point light."""


@wp.struct
class Grid:
    """Holds which casters may lie between a point and each light, by cells of G grids.

    of: for every light of the scene its number among those that have grids, or -1. first, faces: of each of these, its
    first grid and how many it has. In a frame with the world's axes, of each grid: place, unit vectors to the right,
    down and ahead; scale: 1 / tan of the half angle of what it sees, or of a parallel one, to which light comes along
    `ahead`, 1 / half of its width [1/m]. turn, shift [E]: camera to that frame; pad [E]: rounding of a place in it [m].
    cells [G SIDE^2 + 2]: where the entries of each cell begin; the last one has all still instances. entries: index
    into casters.order, and the bits of the least distance ahead of the light, ascending. lower, upper [still]: boxes,
    wider by `slack` [m] or more. masks [E, G, COARSE^2]: bits of casters.order[still ...].
    """

    of: wp.array(dtype=int)
    first: wp.array(dtype=int)
    faces: wp.array(dtype=int)
    parallel: wp.array(dtype=int)
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


@wp.func
def face_towards(grid: Grid, n: int, away: wp.vec3):
    """Gives the grid of light n, counted among those that have any, that sees what lies in the direction `away`."""
    g = grid.first[n]
    if grid.faces[n] == CUBE:
        size = wp.abs(away)
        k = wp.int32(0)
        if size[1] > size[k]:
            k = 1
        if size[2] > size[k]:
            k = 2
        g += 2 * k
        if away[k] < 0.0:
            g += 1
    return g


@wp.func
def cell_of(grid: Grid, n: int, env: int, origin: wp.vec3, start: wp.vec3):
    """Gives the grid of light n that the way from a point to it lies in, its column and row [0, 1) there, how far ahead
    of the light the point is [m], and EVERYBODY or MOVERS_ONLY where no cell is sure to hold the way, otherwise 0.
    origin, start: the point in the camera's frame and the grid's."""
    g = face_towards(grid, n, start - grid.place[grid.first[n]])
    away = start - grid.place[g]
    ahead = wp.dot(away, grid.ahead[g])
    # A ray does not end at the light but as far beside it as it starts above its surface, and rounding comes to that.
    beside = LIFT * (wp.length(origin) + grid.slack) + grid.pad[env]
    if ahead > BEFORE and 4.0 * beside < grid.slack:
        half = 0.5 * grid.scale[g]
        if grid.parallel[g] == 0:
            half /= ahead
        x = wp.dot(away, grid.right[g]) * half + 0.5
        y = wp.dot(away, grid.down[g]) * half + 0.5
        if x >= 0.0 and y >= 0.0 and x < 1.0 and y < 1.0:
            return g, x, y, ahead, 0
        if grid.parallel[g] == 1:
            return g, 0.0, 0.0, ahead, MOVERS_ONLY
    return g, 0.0, 0.0, ahead, EVERYBODY


@wp.func
def hidden_from(
    casters: Casters,
    grid: Grid,
    light: int,
    env: int,
    skip: int,
    origin: wp.vec3,
    direction: wp.vec3,
    length: float,
):
    """Tells whether any caster but `skip` is between a point and a light, counted among those that have a grid: what
    `occluded` says of all casters."""
    start = grid.turn[env] * origin + grid.shift[env]
    g, x, y, ahead, whole = cell_of(grid, light, env, origin, start)
    cell = grid.cells.shape[0] - 2
    movers = ~wp.uint64(0)
    if whole == 0:
        cell = (g * SIDE + int(y * float(SIDE))) * SIDE + int(x * float(SIDE))
        movers = grid.masks[env, g, int(y * float(COARSE)) * COARSE + int(x * float(COARSE))]
    along = grid.turn[env] * direction
    inverse = inverse_of(along)
    k = grid.cells[cell]
    end = grid.cells[cell + 1]
    if whole == MOVERS_ONLY:
        k = end
    moving = casters.order.shape[0] - casters.still
    # One loop for all, for a GPU's threads then try their meshes together.
    while k < end or movers != wp.uint64(0):
        n = wp.int32(-1)
        if k < end:
            entry = grid.entries[k]
            k += 1
            if whole == 0 and wp.cast(entry[1], wp.float32) >= ahead:
                k = end
            elif hits_box(grid.lower[entry[0]] - start, grid.upper[entry[0]] - start, inverse, length):
                n = entry[0]
        else:
            bit = lowest(movers)
            movers = movers & (movers - wp.uint64(1))
            if bit < moving:
                n = casters.still + bit
        if n >= 0:
            i = casters.order[n]
            if i != skip:
                if hits_instance(casters, env, i, origin, direction, length, 0.0):
                    return True
    return False


@wp.func
def cell_below(at: float):
    """Gives the cell of a place from -1 to 1 over the grid, or that before it where rounding might tell, or the end."""
    return int(wp.floor(wp.clamp((0.5 * at + 0.5) * float(COARSE) - 0.01, 0.0, float(COARSE))))


@wp.func
def cell_above(at: float):
    """Gives the cell of a place, or that after it where rounding might tell, or -1 before the first."""
    return int(wp.floor(wp.clamp((0.5 * at + 0.5) * float(COARSE) + 0.01, -1.0, float(COARSE - 1))))


@wp.kernel
def mark_movers(
    # in
    casters: Casters,
    # in and out
    grid: Grid,
):
    """Sets the bits of the moving instances in all cells that may hold anything of their boxes; all were 0."""
    env, g, n = wp.tid()
    i = casters.order[casters.still + n]
    centre = grid.turn[env] * casters.translation[env, i] + grid.shift[env] - grid.place[g]
    turn = grid.turn[env] * casters.rotation[env, i]
    half = casters.outer[i] + wp.vec3(grid.slack, grid.slack, grid.slack)
    far = wp.float32(-wp.inf)
    near = wp.float32(wp.inf)
    low = wp.vec2(wp.inf, wp.inf)
    high = wp.vec2(-wp.inf, -wp.inf)
    for k in range(8):
        corner = half
        if (k & 1) != 0:
            corner[0] = -half[0]
        if (k & 2) != 0:
            corner[1] = -half[1]
        if (k & 4) != 0:
            corner[2] = -half[2]
        at = centre + turn * corner
        ahead = wp.dot(at, grid.ahead[g])
        scale = grid.scale[g]
        if grid.parallel[g] == 0:
            scale = scale / wp.max(ahead, BEFORE)
        seen = scale * wp.vec2(wp.dot(at, grid.right[g]), wp.dot(at, grid.down[g]))
        low = wp.min(low, seen)
        high = wp.max(high, seen)
        near = wp.min(near, ahead)
        far = wp.max(far, ahead)
    if far <= BEFORE:
        return
    x0 = wp.int32(0)
    y0 = wp.int32(0)
    x1 = COARSE - 1
    y1 = COARSE - 1
    if grid.parallel[g] == 1 or near > BEFORE:
        x0 = cell_below(low[0])
        y0 = cell_below(low[1])
        x1 = cell_above(high[0])
        y1 = cell_above(high[1])
    for y in range(y0, y1 + 1):
        for x in range(x0, x1 + 1):
            wp.atomic_or(grid.masks, env, g, y * COARSE + x, wp.uint64(1) << wp.uint64(n))
