"""Follows the point that a pixel sees over a surface by how fine that is painted: one that no keyframe shows, or whose
picture is finer than keyframes' pixels."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.refine.paths.grain import EVEN
from nodes.interpolator.refine.paths.listing_kernels import PAINTED, UNKNOWN, make_instances, make_note
from nodes.interpolator.refine.paths.motion_kernels import motion_since
from nodes.interpolator.refine.stage_kernels import Cut, Spot, Stage, entry_at
from nodes.interpolator.rigid.look_up.look_up_kernels import make_keyframes
from nodes.renderer.raster.depth_kernels import MISS, depth_of, triangle_of
from nodes.renderer.raster.lens.view_kernels import CameraView, pixel_width, ray_steps

wp.set_module_options({"enable_backward": False})

PER_SWING = wp.constant(3.0)
"""Samples for each length over which a texture goes up or down: with 2 a wall whose texels are a pixel wide loses 10 %
of its events at 2 px a gap and 0.3 ms, with 3 7 %, and scenes take the same time."""
PLAIN = wp.constant(EVEN)
TURNED = wp.constant(0.25)
"""Way since the last sample, of that between two, after which there is one where a point turns back: what shakes shows
there how far it goes."""


@wp.func
def finer_than_pixels(view: CameraView, stage: Stage, spot: Spot, hit: wp.uint64):
    """Tells whether the triangle of a z-buffer entry is painted more finely than the pixels of an image show."""
    t = triangle_of(hit)
    if t == MISS:
        return False
    return stage.targets.grain[t] < pixel_width(view, spot.x, spot.y, depth_of(hit))


@wp.func
def pixels_along(view: CameraView, spot: Spot, away: float, step: wp.vec3):
    """Computes how many pixels wide a step [m] in the camera's frame appears, from where a pixel sees something.

    away: of that, in multiples of `spot.d`. What is along the ray does not count, so that a surface which is seen
    obliquely has long pixels.
    """
    across, down = ray_steps(view, spot.x, spot.y)
    normal = wp.cross(across, down)
    u = wp.dot(step, wp.cross(down, spot.d))
    v = wp.dot(step, wp.cross(spot.d, across))
    return wp.sqrt(u * u + v * v) / wp.max(away * wp.abs(wp.dot(normal, spot.d)), 1.0e-30)


@cache
def make_follow(channels: int, ways: int) -> Any:
    """Makes the function `follow`; arguments as of make_look_up."""
    pixel: Any = wp.float32 if channels == 1 else wp.vec3
    Keyframes: Any = make_keyframes(channels, ways)
    Instances: Any = make_instances(channels)
    note = make_note(channels)

    @wp.func
    def follow(
        view: CameraView,
        cut: Cut,
        keys: Keyframes,
        stage: Stage,
        instances: Instances,
        spot: Spot,
        start: int,
        end: int,
        before: wp.uint64,
        after: wp.uint64,
        last: int,
        room: int,
        most: int,
        band: int,
        count: wp.array(dtype=int),
    ):
        """Lists instants from `start` to `end` between which a pixel goes over part of a swing of what is painted on
        the surface, and by `cut.spacing` at least, and those at which it turns back. Arguments as of `walk`;
        gives the index of the last entry listed, and PAINTED, or UNKNOWN where it goes nowhere."""
        body = stage.targets.pieces[triangle_of(before)][0]
        each = (cut.slots + 1) // stage.probes[spot.env]
        listed = start
        moved = wp.bool(False)
        gone = wp.float32(0.0)
        i = start
        hit = before
        # Points of one body keep their distances in the frame of keyframe A's camera.
        motion = motion_since(cut, stage, keys.turn, keys.shift, spot.env, spot.k, 0, i, body)
        point = depth_of(hit) * spot.d
        here = point + motion.turn * point + motion.shift
        heading = wp.vec3(0.0)
        while i < end:
            following = wp.min(end, (i | (each - 1)) + 1)
            seen = after
            if following < end:
                seen = entry_at(cut, stage, spot, following)
            motion = motion_since(cut, stage, keys.turn, keys.shift, spot.env, spot.k, 0, following, body)
            point = depth_of(seen) * spot.d
            there = point + motion.turn * point + motion.shift
            step = there - here
            way = wp.length(step)
            wide = pixels_along(view, spot, depth_of(seen), step + wp.transpose(motion.turn) * step)
            grain = wp.min(stage.targets.grain[triangle_of(hit)], stage.targets.grain[triangle_of(seen)])
            # Pixels are long on what is seen obliquely: by that alone tunnel_exit has 0.048 in place of 0.034.
            narrow = wp.min(way / wp.max(wide, 1.0e-30), pixel_width(view, spot.x, spot.y, depth_of(seen)))
            spacing = wp.max(grain / PER_SWING, cut.spacing * narrow)
            moved = moved or (grain < PLAIN and gone + way > TURNED * spacing)
            if grain < PLAIN and i > listed and gone > TURNED * spacing and wp.dot(step, heading) < 0.0:
                last = note(cut, instances, spot, i, hit, hit, pixel(PAINTED), last, room, most, band, count)
                listed = i
                gone = 0.0
            if grain < PLAIN and gone + way >= spacing:
                to_next = wp.max(spacing - gone, 0.0)
                pace = float(following - i) / way
                while to_next < way:
                    place = i + int(to_next * pace)
                    if place > listed and place < end:
                        last = note(
                            cut, instances, spot, place, hit, seen, pixel(PAINTED), last, room, most, band, count
                        )
                        listed = place
                    gone = way - to_next
                    to_next += wp.max(spacing, way / float(following - i))
            else:
                gone += way
            heading = step
            here = there
            hit = seen
            i = following
        rise = pixel(UNKNOWN)
        if moved:
            rise = pixel(PAINTED)
        return last, rise

    return follow
