"""Follows the point that a pixel sees over a surface, looked up in a keyframe, and finds where ln I bends."""

from functools import cache
from typing import Any

import warp as wp

from evis.gpu.append_kernels import take_place
from evis.gpu.reading_kernels import element, number, whole_number
from nodes.interpolator.refine.paths.motion_kernels import motion_since, stride_of
from nodes.interpolator.refine.stage_kernels import Cut, Spot, Stage, entry_at, slot_row
from nodes.interpolator.rigid.look_up.log_kernels import apart, log_type
from nodes.interpolator.rigid.look_up.look_up_kernels import make_displacement, make_keyframes
from nodes.interpolator.rigid.patch_kernels import patch_of
from nodes.renderer.raster.depth_kernels import MISS, depth_of, triangle_of
from nodes.renderer.raster.lens.view_kernels import CameraView

wp.set_module_options({"enable_backward": False})

LEAST_STEP = wp.constant(0.02)
"""Shortest way [px] over a surface along which ln I is looked up."""
LONG = wp.constant(4.0)
"""Longest way [px] that is taken for straight where the body's motion is: perspective and depth bend longer ones."""
MOST_STEPS = wp.constant(48)
PER_PIXEL = wp.constant(2.0)
"""Look-ups per pixel of the way, of at most MOST_STEPS."""
ROUGH_STEP = wp.constant(0.5)
"""Way [px] over a surface whose neighbouring pixels differ, after which a sample is taken: interpolation between these
pixels may hide most of the surface's contrast."""
NEARER = wp.constant(0.1)
"""Share of its inverse distance by which a keyframe shows a surface nearer where it cannot be the same part of it."""
UNKNOWN = wp.constant(1.0e30)
"""Stands for a change of ln I that cannot be looked up in a keyframe."""
PAINTED = wp.constant(4.0e30)
"""The same, of what is followed by how finely it is painted: ln I goes up and down there, but never in a step."""
STEEPEST = wp.constant(1.0e30)
PARTS = wp.constant(64)
"""Parts of the time from one instant to the next."""
SHARP = wp.constant(2)
"""Half of the time that one surface takes to give way to the next, and light to be switched, in PARTS."""
FRAME_BEFORE = wp.constant(1)
FRAME_AFTER = wp.constant(2)
TOLD = wp.constant(3)


@cache
def make_instances(channels: int) -> Any:
    """Makes the struct of a list of pixels at instants; channels: 1 (luminance) or 3 (RGB).

    at: index into [slots, E, h, w]. before, after: z-buffer entries at known instants before and after. previous: index
    in the list of the one before, of the same pixel and coarse interval, -1 = none. later: time of the sample after its
    instant, in PARTS, negative = before it. rise: change of ln I since the previous one, or since the coarse frame
    before, looked up in a keyframe, or UNKNOWN. ends: 1 for the last one of a coarse interval. tail: change of ln I
    from there to the coarse frame after. shown: of a sample that has the value of a coarse frame in place of its own,
    that before, FRAME_BEFORE, or after, FRAME_AFTER; 0 = its own, TOLD = that of which `rise` is the logarithm.
    """
    pixel: Any = wp.float32 if channels == 1 else wp.vec3

    class Instances:
        at: wp.array(dtype=int)
        before: wp.array(dtype=wp.uint64)
        after: wp.array(dtype=wp.uint64)
        previous: wp.array(dtype=int)
        later: wp.array(dtype=int)
        rise: wp.array(dtype=pixel)
        ends: wp.array(dtype=int)
        tail: wp.array(dtype=pixel)
        shown: wp.array(dtype=int)

    Instances.__qualname__ = f"Instances{channels}"
    return wp.struct(Instances)


@wp.func
def outside(rise: wp.float32, low: wp.float32, high: wp.float32):
    """Tells whether a rise is below `low` or above `high`, in RGB in any channel."""
    return rise < low or rise > high


@wp.func
def outside(rise: Any, low: Any, high: Any):  # noqa: F811 - overloaded by its type
    result = wp.bool(False)
    for i in range(len(rise)):
        result = result or rise[i] < low[i] or rise[i] > high[i]
    return result


@cache
def make_note(channels: int) -> Any:
    """Makes the function `note`; channels: 1 (luminance) or 3 (RGB)."""
    pixel: Any = wp.float32 if channels == 1 else wp.vec3
    Instances: Any = make_instances(channels)

    @wp.func
    def note(
        cut: Cut,
        instances: Instances,
        spot: Spot,
        i: int,
        before: wp.uint64,
        after: wp.uint64,
        rise: pixel,
        previous: int,
        room: int,
        most: int,
        band: int,
        count: wp.array(dtype=int),
    ):
        """Adds instant i of a pixel to the list, from `room` on, unless it has `most` entries. Gives its index."""
        n = take_place(count, band)
        if n < most:
            instances.at[room + n] = slot_row(cut, 0, spot.k, i) * cut.height * cut.width + spot.q
            instances.before[room + n] = before
            instances.after[room + n] = after
            instances.previous[room + n] = previous
            instances.rise[room + n] = rise
            instances.ends[room + n] = 0
            instances.later[room + n] = 0
            instances.tail[room + n] = pixel(UNKNOWN)
            instances.shown[room + n] = 0
        return room + wp.min(n, most - 1)

    return note


@cache
def make_walk(lens: str, channels: int, ways: int) -> Any:
    """Makes the function `walk`; arguments as of make_look_up."""
    pixel: Any = wp.float32 if channels == 1 else wp.vec3
    looked_up: Any = log_type(channels, ways)
    Keyframes: Any = make_keyframes(channels, ways)
    Instances: Any = make_instances(channels)
    displacement = make_displacement(lens)
    note, bent = make_note(channels), lens != "none"
    log_at = number if looked_up is wp.float32 else element

    @wp.func
    def place_then(
        view: CameraView,
        cut: Cut,
        keys: Keyframes,
        stage: Stage,
        spot: Spot,
        which: int,
        i: int,
        body: int,
        away: float,
    ):
        """Computes where (x, y) [px] keyframe `which` shows the point that a pixel sees at instant i, and the inverse
        of its distance there [1/m].

        body: that the point is on. away: its distance along the ray, in multiples of `spot.d`.
        """
        point = away * spot.d
        motion = motion_since(cut, stage, keys.turn, keys.shift, spot.env, spot.k, which, i, body)
        m = motion.turn * point + motion.shift
        near = wp.where(body == keys.turn.shape[1] - 1, 1.0e-6, view.near)
        moved = displacement(view, spot.d, point, m, near)
        q = point + m
        return wp.vec3(
            float(spot.x) + moved[0], float(spot.y) + moved[1], 1.0 / wp.where(wp.static(bent), wp.length(q), q[2])
        )

    @wp.func
    def in_view(view: CameraView, keys: Keyframes, base: int, at: wp.vec3, sky: bool):
        """Tells whether all four pixels around a place are in the image, and what a keyframe shows there is not nearer
        than the place: of a ball that has turned it shows the other side."""
        if at[0] >= 0.0 and at[1] >= 0.0 and at[0] < float(view.width - 1) and at[1] < float(view.height - 1):
            shown = number(keys.inverse, base + int(at[1] + 0.5) * view.width + int(at[0] + 0.5))
            return sky or shown - at[2] <= NEARER * at[2]
        return False

    @wp.func
    def look(view: CameraView, keys: Keyframes, base: int, at: wp.vec2, patch: int):
        """Tells whether a keyframe shows a patch at a place, ln I there, and how far the four pixels about it differ.

        ln I is interpolated bilinearly, or the nearest pixel's where not all four show the patch.
        """
        # Rounding may put the end of a way onto the image's border.
        left = wp.min(int(at[0]), view.width - 2)
        top = wp.min(int(at[1]), view.height - 2)
        fx = at[0] - float(left)
        fy = at[1] - float(top)
        here = base + top * view.width + left
        below = here + view.width
        a = log_at(keys.logs, here)
        b = log_at(keys.logs, here + 1)
        c = log_at(keys.logs, below)
        d = log_at(keys.logs, below + 1)
        spread = apart(wp.min(wp.min(a, b), wp.min(c, d)), wp.max(wp.max(a, b), wp.max(c, d)))
        # One number tells where all is the patch, but at the border and of what never moves.
        one = whole_number(keys.support, here) >> 2 == patch
        if not one:
            upper_two = whole_number(keys.patch, here) == patch and whole_number(keys.patch, here + 1) == patch
            lower_two = whole_number(keys.patch, below) == patch and whole_number(keys.patch, below + 1) == patch
            one = upper_two and lower_two
        if one:
            upper = a + fx * (b - a)
            lower = c + fx * (d - c)
            return True, upper + fy * (lower - upper), spread
        nearest = here + int(fy + 0.5) * view.width + int(fx + 0.5)
        return whole_number(keys.patch, nearest) == patch, log_at(keys.logs, nearest), spread

    @wp.func
    def walk(
        view: CameraView,
        cut: Cut,
        keys: Keyframes,
        stage: Stage,
        instances: Instances,
        spot: Spot,
        which: int,
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
        """Follows a pixel over one surface from instant `start` to `end` in keyframe `which`, and lists the instants
        between which ln I is straight within cut.straight.

        before, after: z-buffer entries at `start` and `end`. last: index of the entry listed before, -1 = none. Gives
        the index of the last entry listed, the change of ln I since, and whether the keyframe shows all of the way.
        """
        patch = wp.int32(0)
        body = keys.turn.shape[1] - 1
        from_here = wp.float32(1.0)
        t = triangle_of(before)
        if t != MISS:
            patch = patch_of(before, stage.targets.pieces[t])
            body = stage.targets.pieces[t][0]
            from_here = depth_of(before)
        base = keys.first[which] + spot.env * view.width * view.height
        each = (cut.slots + 1) // stage.probes[spot.env]
        here = place_then(view, cut, keys, stage, spot, which, start, body, from_here)
        nothing = pixel(UNKNOWN)
        if not in_view(view, keys, base, here, t == MISS):
            return last, nothing, False
        _shown, anchor, _spread = look(view, keys, base, wp.vec2(here[0], here[1]), patch)
        anchored = float(start)
        value = anchor
        then = anchored
        told = anchor
        listed = start
        gone = wp.float32(0.0)
        bend = looked_up(cut.straight)
        low = looked_up(-STEEPEST)
        high = looked_up(STEEPEST)
        stride = stride_of(cut, stage, spot, which, body, from_here)
        i = start
        hit = before
        while i < end:
            following = wp.int32(0)
            seen = after
            step = wp.vec3(0.0, 0.0, 0.0)
            length = wp.float32(0.0)
            settled = wp.bool(False)
            while not settled:
                # Both are powers of two.
                following = wp.min(end, (i | (stride - 1)) + 1)
                seen = after
                if following < end:
                    seen = entry_at(cut, stage, spot, following)
                away = from_here
                if t != MISS:
                    away = depth_of(seen)
                there = place_then(view, cut, keys, stage, spot, which, following, body, away)
                if not in_view(view, keys, base, there, t == MISS):
                    return last, nothing, False
                step = there - here
                length = wp.length(wp.vec2(step[0], step[1]))
                settled = length <= LONG or stride <= each
                if not settled:
                    stride = stride >> 1
            if length > LEAST_STEP or i > start:
                steps = wp.min(int(PER_PIXEL * length) + 1, MOST_STEPS)
                share = 1.0 / float(steps)
                pace = share * float(following - i)
                for n in range(1, steps + 1):
                    at = wp.vec2(here[0] + float(n) * share * step[0], here[1] + float(n) * share * step[1])
                    now = float(i) + float(n) * pace
                    shown, fresh, spread = look(view, keys, base, at, patch)
                    if not shown:
                        return last, nothing, False
                    gone += length * share
                    rough = gone > ROUGH_STEP and spread > cut.rough
                    rise = fresh - anchor
                    if outside(rise, (now - anchored) * low, (now - anchored) * high) or rough:
                        # The sample before is the last one that a straight line reaches.
                        place = int(then + 0.5)
                        if place > listed and place < end:
                            change = pixel(UNKNOWN)
                            if wp.static(ways == 0):
                                change = value - told
                            ahead = hit
                            behind = seen
                            if triangle_of(hit) != triangle_of(seen):
                                # What is nearer in time tells more of what is between.
                                probe = place // each * each
                                if probe > i:
                                    ahead = entry_at(cut, stage, spot, probe)
                                if probe + each < following:
                                    behind = entry_at(cut, stage, spot, probe + each)
                            last = note(
                                cut, instances, spot, place, ahead, behind, change, last, room, most, band, count
                            )
                            told = value
                            listed = place
                        anchor = value
                        anchored = then
                        rise = fresh - anchor
                        gone = wp.float32(0.0)
                        low = looked_up(-STEEPEST)
                        high = looked_up(STEEPEST)
                    over = 1.0 / (now - anchored)
                    low = wp.max(low, over * (rise - bend))
                    high = wp.min(high, over * (rise + bend))
                    value = fresh
                    then = now
            here += step
            hit = seen
            i = following
        change = pixel(UNKNOWN)
        if wp.static(ways == 0):
            change = value - told
        return last, change, True

    return walk
