"""Holds what the kernels of a window read: its limits and sizes, the scene at its instants, and what pixels see
there."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.displacement_kernels import BodyMotion
from nodes.interpolator.image_kernels import pixel_type
from nodes.interpolator.refine.evaluation.visibility_kernels import Targets
from nodes.interpolator.refine.frame_kernels import light_at_start
from nodes.interpolator.refine.probing.probe_kernels import probe_image
from nodes.interpolator.rigid.plan_kernels import same_surface
from nodes.renderer.raster.depth_kernels import triangle_of
from nodes.renderer.raster.lens.view_kernels import CameraView, pixel_ray
from nodes.renderer.raster.surface_kernels import Surfaces

wp.set_module_options({"enable_backward": False})

FEW_REGISTERS = 64
"""Registers of a GPU's thread in kernels that wait for memory most of the time, so that there are others meanwhile."""


@wp.struct
class WindowParameters:
    """Holds the limits beyond which an interval is halved, and the sizes of the present window.

    jump: difference of ln I between the ends of an interval. bend: distance of ln I inside it from the straight line,
    or from what was looked up. straight: the same distance within a keyframe. rough: difference of ln I between
    neighbouring pixels of a keyframe, beyond which look-ups may miss contrast. first: the window's first coarse
    interval. coarse: coarse intervals of the gap, K. slots: instants inside a coarse interval, 2^depth - 1. probes:
    parts that z-buffers make of a coarse interval, 2^n. parts: those at whose ends it is known which lamps shine, 2^n,
    at most; 0 = unknown. rows: of the coarse frames' z-buffers. height, width [px]: of a frame, without margin [px].
    gain: pixels per radian, at most, or the focal length [px] of a pinhole. even: distance [px] from a straight way up
    to which a point is on it. spacing: least way over what is painted between two samples, of a pixel's width along it.
    """

    jump: float
    bend: float
    straight: float
    rough: float
    first: int
    coarse: int
    slots: int
    depth: int
    probes: int
    parts: int
    rows: int
    envs: int
    height: int
    width: int
    margin: int
    gain: float
    even: float
    spacing: float


@wp.struct
class PixelInterval:
    """Holds a pixel and a coarse interval.

    env: environment. x, y: pixel in the image with its margin. q: its index into [E, h, w]. k: number of the coarse
    interval. d: the pixel's ray; depth times d is the point that it sees.
    """

    env: int
    x: int
    y: int
    q: int
    k: int
    d: wp.vec3


@wp.struct
class WindowScene:
    """Holds the scene at the instants of a window.

    motions [2 R, N + 2]: of the bodies since A, then since B. held [E]: 1 for environments that have no
    gap. packed_a [E, H, W]: z-buffer of keyframe A. packed: [rows, H, W], z-buffers of B and of sub-frames 1 .. K - 1.
    probed, probes: `packed` and `each` of Probes. bends: as of find_bends. parts: of each environment [2, E], see
    WindowParameters: for shadows and beams, and for facets. light_changes: as of find_light_changes. alpha: of each
    instance's material, -1 for a plain one. targets: what rays can meet. surfaces: what they look like.
    """

    motions: wp.array2d(dtype=BodyMotion)
    held: wp.array(dtype=int)
    packed_a: wp.array3d(dtype=wp.uint64)
    packed: wp.array3d(dtype=wp.uint64)
    probed: wp.array3d(dtype=wp.uint64)
    probes: wp.array(dtype=int)
    bends: wp.array3d(dtype=wp.vec2)
    parts: wp.array2d(dtype=int)
    light_changes: wp.array3d(dtype=wp.uint64)
    alpha: wp.array(dtype=float)
    targets: Targets
    surfaces: Surfaces


@wp.struct
class Run:
    """Holds a part of a coarse interval in which a pixel shows one surface.

    start, end: instants within the coarse interval. before, after: z-buffer entries there. last: index of the request
    listed before it, -1 = none.
    """

    start: int
    end: int
    before: wp.uint64
    after: wp.uint64
    last: int


@wp.struct
class EndEntries:
    """Holds a pixel's z-buffer entries at both ends of a coarse interval."""

    before: wp.uint64
    after: wp.uint64


@cache
def make_coarse_frames(channels: int) -> Any:
    """Makes the struct of the frames at the ends of coarse intervals; channels: 1 (luminance) or 3 (RGB).

    image_a: radiance of keyframe A, [E, H, W] with its margin. frames: [E K, h, w], the last one of an environment B.
    """
    pixel = pixel_type(channels)

    class CoarseFrames:
        image_a: wp.array3d(dtype=pixel)
        frames: wp.array3d(dtype=pixel)

    CoarseFrames.__qualname__ = f"CoarseFrames{channels}"
    return wp.struct(CoarseFrames)


@wp.func
def pixel_interval_at(view: CameraView, params: WindowParameters, env: int, k: int, y: int, x: int):
    """Makes the PixelInterval of coarse interval k and the pixel in row y and column x of a frame."""
    px = PixelInterval()
    px.k = k
    px.q = (env * params.height + y) * params.width + x
    px.x = x + params.margin
    px.y = y + params.margin
    px.env = env
    px.d = pixel_ray(view, px.x, px.y)
    return px


@wp.func
def pixel_interval_of(view: CameraView, params: WindowParameters, at: int):
    """Makes the PixelInterval of an index into [coarse intervals of the window, E, h, w]."""
    row = at // params.width
    image = row // params.height
    return pixel_interval_at(
        view, params, image % params.envs, params.first + image // params.envs, row % params.height, at % params.width
    )


@wp.struct
class SlotPixel:
    """Holds a pixel at an instant of the window.

    k: number of its coarse interval; i: the instant within that, counted from 1. q: index of the pixel into [E, h, w];
    env, y, x: its coordinates there.
    """

    k: int
    i: int
    q: int
    env: int
    y: int
    x: int


@wp.func
def slot_pixel_of(params: WindowParameters, at: int):
    """Makes the SlotPixel of an index into [slots, E, h, w]."""
    inner = params.envs * params.height * params.width
    slot = at // inner
    place = SlotPixel()
    place.k = params.first + slot // params.slots
    place.i = slot % params.slots + 1
    place.q = at % inner
    place.env = place.q // (params.width * params.height)
    place.y = place.q // params.width % params.height
    place.x = place.q % params.width
    return place


@wp.func
def instant_of(params: WindowParameters, at: int):
    """Gives the instant within its coarse interval, counted from 1, of an index into [slots, E, h, w]."""
    return at // (params.envs * params.height * params.width) % params.slots + 1


@wp.func
def probe_spacing(params: WindowParameters, scene: WindowScene, env: int):
    """Gives how many instants it is from one probe of an environment to the next."""
    return (params.slots + 1) // scene.probes[env]


@wp.func
def frame_before(params: WindowParameters, coarse: Any, env: int, k: int, y: int, x: int):
    """Reads a pixel of the frame at which coarse interval k begins, of CoarseFrames."""
    return light_at_start(coarse.image_a, coarse.frames, params.coarse, params.margin, env, k, y, x)


@wp.func
def frame_after(params: WindowParameters, coarse: Any, env: int, k: int, y: int, x: int):
    """Reads a pixel of the frame at which coarse interval k ends, of CoarseFrames."""
    return coarse.frames[env * params.coarse + k, y, x]


@wp.func
def entry_before(params: WindowParameters, scene: WindowScene, env: int, k: int, y: int, x: int):
    """Reads the z-buffer entry of `frame_before`."""
    if k == 0:
        return scene.packed_a[env, y + params.margin, x + params.margin]
    return scene.packed[k * params.envs + env, y + params.margin, x + params.margin]


@wp.func
def entry_after(params: WindowParameters, scene: WindowScene, env: int, k: int, y: int, x: int):
    """Reads the z-buffer entry of `frame_after`: that of B, the last frame, stands first."""
    row = wp.where(k + 1 == params.coarse, 0, k + 1) * params.envs + env
    return scene.packed[row, y + params.margin, x + params.margin]


@wp.func
def end_entries_of(params: WindowParameters, scene: WindowScene, px: PixelInterval):
    """Reads the z-buffer entries at both ends of a coarse interval."""
    y = px.y - params.margin
    x = px.x - params.margin
    ends = EndEntries()
    ends.before = entry_before(params, scene, px.env, px.k, y, x)
    ends.after = entry_after(params, scene, px.env, px.k, y, x)
    return ends


@wp.func
def entry_at(params: WindowParameters, scene: WindowScene, px: PixelInterval, i: int):
    """Reads the z-buffer entry of the probe at instant i of the coarse interval."""
    image = probe_image(params.coarse, px.k, i, params.slots + 1)
    return scene.probed[image * params.envs + px.env, px.y, px.x]


@wp.func
def shows_one(params: WindowParameters, scene: WindowScene, px: PixelInterval, before: wp.uint64, after: wp.uint64):
    """Tells whether a pixel shows one piece of surface at both ends of a coarse interval and at all probes."""
    t = triangle_of(before)
    alike = triangle_of(after) == t
    probes = scene.probes[px.env]
    # Mostly it is one triangle; then the order of the probes does not matter: they are gone through as they lie.
    half = wp.int32(1)
    while alike and half < probes:
        first = probe_image(params.coarse, px.k, 1, 2 * half)
        for i in range(half):
            alike = alike and triangle_of(scene.probed[(first + i) * params.envs + px.env, px.y, px.x]) == t
        half = 2 * half
    if alike:
        return True
    each = (params.slots + 1) // probes
    one = wp.bool(True)
    hit = before
    for i in range(1, probes + 1):
        if one:
            then = after
            if i < probes:
                then = entry_at(params, scene, px, i * each)
            one = same_surface(hit, then, scene.targets.pieces)
            hit = then
    return one


@wp.func
def parts_of(scene: WindowScene, env: int):
    """Gives into how many parts a coarse interval of an environment is divided, at whose ends it is known which lamps
    shine."""
    return wp.max(scene.parts[0, env], scene.parts[1, env])


@wp.func
def slot_row(params: WindowParameters, env: int, k: int, i: int):
    """Gives the row of instant i of coarse interval k in arrays of all slots, [slots E, ...]."""
    return ((k - params.first) * params.slots + i - 1) * params.envs + env


@wp.func
def rows_of(params: WindowParameters, env: int, k: int, i: int):
    """Gives the rows from which `weights_then` knows instant i of coarse interval k: its own, and -1; or, at an end of
    the interval, which has none, those of the next two instants inside."""
    rows = wp.vec2i(slot_row(params, env, k, wp.clamp(i, 1, params.slots)), -1)
    if i == 0:
        rows[1] = slot_row(params, env, k, 2)
    if i > params.slots:
        rows[1] = slot_row(params, env, k, params.slots - 1)
    return rows
