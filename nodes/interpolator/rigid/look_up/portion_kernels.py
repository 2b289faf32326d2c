"""Describes a portion of a gap's sub-frames that is looked up at once, and finds where in it a pixel is."""

from typing import Any

import warp as wp

from evis.gpu.division_kernels import Divisor, divided, divisor
from nodes.interpolator.rigid.look_up.look_up_kernels import VisiblePoint
from nodes.interpolator.rigid.patch_kernels import patch_of
from nodes.renderer.raster.depth_kernels import MISS, depth_of, triangle_of
from nodes.renderer.raster.lens.view_kernels import CameraView, pixel_ray

wp.set_module_options({"enable_backward": False})


@wp.struct
class Portion:
    """Holds instants that are looked up together: those in `count` slots from slot0 on of `packed` [P E, H, W]; slot
    s is at index[s] / upsampling of the gap and frame[s] of `frames` in each environment's output, and lights that
    flicker have that `strength` then, [P E waveforms].

    unchanged [E, H, W]: z-buffer entries with which nothing has changed. pieces: of each triangle, its body (the
    world's index being their number) and its front's patch. tolerance: difference of the keyframes' log radiance up
    to which it is blended; pace: path [px] per unit of `index` from which on what is finer than a keyframe's pixels
    does not matter; relight: 1 where all but the sky is to be shaded anew. keyframes: first rows of A and B in
    their pair. by_width, by_height [px], by_count, by_envs: what indices of pixels of frames are divided by, see
    `set_divisors`.
    """

    slot0: int
    envs: int
    frames: int
    upsampling: int
    tolerance: float
    pace: float
    relight: int
    count: int
    keyframes: wp.vec2i
    by_width: Divisor
    by_height: Divisor
    by_count: Divisor
    by_envs: Divisor
    index: wp.array(dtype=int)
    frame: wp.array(dtype=int)
    strength: wp.array(dtype=float)
    packed: wp.array3d(dtype=wp.uint64)
    unchanged: wp.array3d(dtype=wp.uint64)
    pieces: wp.array(dtype=wp.vec2i)


def set_divisors(portion: Any, width: int, height: int) -> None:
    """Fills in what indices of a portion's pixels are divided by. width, height [px]: of a frame without margin."""
    portion.by_width, portion.by_height = divisor(width), divisor(height)
    portion.by_count, portion.by_envs = divisor(portion.count), divisor(portion.envs)


@wp.struct
class Place:
    """Holds the coordinates of a pixel within a portion.

    at: its index into [count, E, h, w], from slot0 on. left: that of the first pixel of its row; row: the number of
    this row, or less than 0 where none is known. slot, env: of the image; y, x: in it, with its margin.
    """

    at: int
    left: int
    row: int
    slot: int
    env: int
    y: int
    x: int


@wp.func
def place_of(view: CameraView, portion: Portion, at: int, before: Place):
    """Finds where a pixel is by its index. before: where another one is, whose row need not be found again."""
    width = view.width - 2 * view.margin
    p = before
    if p.row < 0 or at < p.left or at - p.left >= width:
        p.row = divided(at, portion.by_width)
        p.left = p.row * width
        image = divided(p.row, portion.by_height)
        p.y = p.row - image * (view.height - 2 * view.margin) + view.margin
        p.slot = divided(image, portion.by_envs)
        p.env = image - p.slot * portion.envs
    p.at = at
    p.x = at - p.left + view.margin
    return p


@wp.func
def place_in_turn(view: CameraView, portion: Portion, j: int):
    """Finds where the pixel of thread j is: a row of one sub-frame comes after that of the other, for they look for
    nearly the same places."""
    height = view.height - 2 * view.margin
    width = view.width - 2 * view.margin
    p = Place()
    p.row = divided(j, portion.by_width)
    line = divided(p.row, portion.by_count)
    p.slot = p.row - line * portion.count
    p.env = divided(line, portion.by_height)
    y = line - p.env * height
    x = j - p.row * width
    p.at = ((p.slot * portion.envs + p.env) * height + y) * width + x
    p.y = y + view.margin
    p.x = x + view.margin
    return p


@wp.func
def visible_point_of(view: CameraView, hit: wp.uint64, y: int, x: int, pieces: wp.array(dtype=wp.vec2i), sky: int):
    """Gives what a pixel shows, and its body; sky: the index that stands for it."""
    s = VisiblePoint()
    s.y = y
    s.x = x
    s.d = pixel_ray(view, x, y)
    s.point = s.d
    s.sky = 1
    body = sky
    t = triangle_of(hit)
    if t != MISS:
        s.sky = 0
        s.point = depth_of(hit) * s.d
        piece = pieces[t]
        body = piece[0]
        s.patch = patch_of(hit, piece)
    return s, body
