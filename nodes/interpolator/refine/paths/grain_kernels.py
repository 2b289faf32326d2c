"""Follows the point that a pixel sees over a surface by how fine that is painted: one that no keyframe shows, or whose
picture is finer than keyframes' pixels."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.refine.paths.grain import EVEN
from nodes.interpolator.refine.paths.listing_kernels import UNKNOWN, make_instances, make_note
from nodes.interpolator.refine.paths.motion_kernels import motion_since
from nodes.interpolator.refine.stage_kernels import Cut, Spot, Stage, entry_at
from nodes.interpolator.rigid.look_up.look_up_kernels import make_keyframes
from nodes.renderer.raster.depth_kernels import MISS, depth_of, triangle_of

wp.set_module_options({"enable_backward": False})

PER_SWING = wp.constant(3.0)
"""Samples for each length over which a texture goes up or down: with 2 a wall whose texels are a pixel wide loses 10 %
of its events at 2 px a gap and 0.3 ms, with 3 7 %, and scenes take the same time."""
PLAIN = wp.constant(EVEN)
LEAST_SPACING = wp.constant(0.35)
"""Least way between two samples, of a pixel's width: with 0.5 a wall with texels of half a pixel loses 24 % of its
events at 6 px a gap and 0.3 ms, with 0.35 13 %, in the same time."""
TURNED = wp.constant(0.25)
"""Way since the last sample, of that between two, after which there is one where a point turns back: what shakes shows
there how far it goes."""


@wp.func
def width_of_pixel(cut: Cut, spot: Spot, hit: wp.uint64):
    """Computes the width of a pixel [m] where it sees a z-buffer entry."""
    return depth_of(hit) * wp.length(spot.d) / cut.gain


@wp.func
def finer_than_pixels(cut: Cut, stage: Stage, spot: Spot, hit: wp.uint64):
    """Tells whether the triangle of a z-buffer entry is painted more finely than the pixels of an image show."""
    t = triangle_of(hit)
    if t == MISS:
        return False
    return stage.targets.grain[t] < width_of_pixel(cut, spot, hit)


@cache
def make_follow(channels: int, ways: int) -> Any:
    """Makes the function `follow`; arguments as of make_look_up."""
    pixel: Any = wp.float32 if channels == 1 else wp.vec3
    Keyframes: Any = make_keyframes(channels, ways)
    Instances: Any = make_instances(channels)
    note = make_note(channels)

    @wp.func
    def on_body(cut: Cut, keys: Keyframes, stage: Stage, spot: Spot, i: int, body: int, hit: wp.uint64):
        """Computes where the point that a pixel sees at instant i was at keyframe A, in the frame of its camera: points
        of one body keep their distances there."""
        point = depth_of(hit) * spot.d
        motion = motion_since(cut, stage, keys.turn, keys.shift, spot.env, spot.k, 0, i, body)
        return point + motion.turn * point + motion.shift

    @wp.func
    def follow(
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
        the surface, and by LEAST_SPACING pixels at least, and those at which it turns back. Arguments as of `walk`;
        gives the index of the last entry listed."""
        body = stage.targets.pieces[triangle_of(before)][0]
        each = (cut.slots + 1) // stage.probes[spot.env]
        listed = start
        gone = wp.float32(0.0)
        i = start
        hit = before
        here = on_body(cut, keys, stage, spot, i, body, hit)
        heading = wp.vec3(0.0)
        while i < end:
            following = wp.min(end, (i | (each - 1)) + 1)
            seen = after
            if following < end:
                seen = entry_at(cut, stage, spot, following)
            there = on_body(cut, keys, stage, spot, following, body, seen)
            way = wp.length(there - here)
            grain = wp.min(stage.targets.grain[triangle_of(hit)], stage.targets.grain[triangle_of(seen)])
            spacing = wp.max(grain / PER_SWING, LEAST_SPACING * width_of_pixel(cut, spot, seen))
            if grain < PLAIN and i > listed and gone > TURNED * spacing and wp.dot(there - here, heading) < 0.0:
                last = note(cut, instances, spot, i, hit, hit, pixel(UNKNOWN), last, room, most, band, count)
                listed = i
                gone = 0.0
            if grain < PLAIN and gone + way >= spacing:
                to_next = wp.max(spacing - gone, 0.0)
                pace = float(following - i) / way
                while to_next < way:
                    place = i + int(to_next * pace)
                    if place > listed and place < end:
                        last = note(
                            cut, instances, spot, place, hit, seen, pixel(UNKNOWN), last, room, most, band, count
                        )
                        listed = place
                    gone = way - to_next
                    to_next += wp.max(spacing, way / float(following - i))
            else:
                gone += way
            heading = there - here
            here = there
            hit = seen
            i = following
        return last

    return follow
