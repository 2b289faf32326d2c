"""Follows the point that a pixel sees over a surface, looked up in a keyframe, and finds where ln I bends."""

from functools import cache
from typing import Any

import warp as wp

from evis.gpu.append_kernels import take_place
from nodes.interpolator.refine.sight_kernels import Targets
from nodes.interpolator.rigid.log_kernels import LOGS, apart
from nodes.interpolator.rigid.look_up_kernels import make_displacement, make_keyframes
from nodes.renderer.raster.depth_kernels import MISS, depth_of, triangle_of
from nodes.renderer.raster.view_kernels import CameraView

wp.set_module_options({"enable_backward": False})

LEAST_STEP = wp.constant(0.02)
"""Shortest way [px] over a surface along which ln I is looked up."""
MOST_STEPS = wp.constant(48)
PER_PIXEL = wp.constant(1.5)
"""Look-ups per pixel of the way, of at most MOST_STEPS."""
ROUGH_STEP = wp.constant(0.5)
"""Way [px] over a surface whose neighbouring pixels differ, after which a sample is taken: interpolation between these
pixels may hide most of the surface's contrast."""
UNKNOWN = wp.constant(1.0e30)
"""Stands for a change of ln I that cannot be looked up in a keyframe."""
STEEPEST = wp.constant(1.0e30)
PARTS = wp.constant(64)
"""Parts of the time from one instant to the next."""
SHARP = wp.constant(2)
"""Half of the time that one surface takes to give way to the next, and light to be switched, in PARTS."""


@wp.struct
class Cut:
    """Holds the limits beyond which an interval is halved, and the sizes of the present window.

    jump: difference of ln I between the ends of an interval. bend: distance of ln I inside it from the straight line,
    or from what was looked up. straight: the same distance within a keyframe. rough: difference of ln I between
    neighbouring pixels of a keyframe, beyond which look-ups may miss contrast. first: the window's first coarse
    interval. coarse: coarse intervals of the gap, K. slots: instants inside a coarse interval, 2^depth - 1. probes:
    parts that z-buffers make of a coarse interval, 2^n. looks: parts at whose ends flickering light is looked at, 2^n.
    rows: of the coarse frames' z-buffers. height, width [px]: of a frame, without margin [px].
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
    rows: int
    envs: int
    height: int
    width: int
    margin: int


@wp.struct
class Spot:
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
class Stage:
    """Holds the scene at the instants of a window.

    turn, shift: [2 R, N + 2], motion of the bodies since A, then since B. packed: [rows, H, W], z-buffers of B and of
    sub-frames 1 .. K - 1. probed, probes: `packed` and `each` of Probes. targets: what rays can meet.
    """

    turn: wp.array2d(dtype=wp.mat33)
    shift: wp.array2d(dtype=wp.vec3)
    packed: wp.array3d(dtype=wp.uint64)
    probed: wp.array3d(dtype=wp.uint64)
    probes: wp.array(dtype=int)
    targets: Targets


@cache
def make_instances(channels: int) -> Any:
    """Makes the struct of a list of pixels at instants; channels: 1 (luminance) or 3 (RGB).

    at: index into [slots, E, h, w]. before, after: z-buffer entries at known instants before and after. previous: index
    in the list of the one before, of the same pixel and coarse interval, -1 = none. later: time of the sample after its
    instant, in PARTS, negative = before it. rise: change of ln I since the previous one, or since the coarse frame
    before, looked up in a keyframe, or UNKNOWN. ends: 1 for the last one of a coarse interval. tail: change of ln I
    from there to the coarse frame after.
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

    Instances.__qualname__ = f"Instances{channels}"
    return wp.struct(Instances)


@wp.func
def outside(slope: wp.float32, low: wp.float32, high: wp.float32):
    """Tells whether a slope is below `low` or above `high`, in RGB in any channel."""
    return slope < low or slope > high


@wp.func
def outside(slope: Any, low: Any, high: Any):  # noqa: F811 - overloaded by its type
    result = wp.bool(False)
    for i in range(len(slope)):
        result = result or slope[i] < low[i] or slope[i] > high[i]
    return result


@wp.func
def entry_at(cut: Cut, stage: Stage, spot: Spot, i: int):
    """Reads the z-buffer entry of the probe at instant i of the coarse interval."""
    half = wp.int32(1)
    odd = (cut.slots + 1) // 2
    while i % odd != 0:
        odd = odd // 2
        half *= 2
    row = cut.coarse * (half - 1) + spot.k * half + i // odd // 2
    return stage.probed[row * cut.envs + spot.env, spot.y, spot.x]


@wp.func
def slot_row(cut: Cut, spot: Spot, i: int):
    """Gives the row of instant i of the coarse interval in arrays of all slots, [slots E, ...]."""
    return ((spot.k - cut.first) * cut.slots + i - 1) * cut.envs + spot.env


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
            instances.at[room + n] = slot_row(cut, spot, i) // cut.envs * cut.envs * cut.height * cut.width + spot.q
            instances.before[room + n] = before
            instances.after[room + n] = after
            instances.previous[room + n] = previous
            instances.rise[room + n] = rise
            instances.ends[room + n] = 0
            instances.later[room + n] = 0
            instances.tail[room + n] = pixel(UNKNOWN)
        return room + wp.min(n, most - 1)

    return note


@cache
def make_walk(lens: str, channels: int, flicker: bool) -> Any:
    """Makes the function `walk`; arguments as of make_look_up."""
    pixel: Any = wp.float32 if channels == 1 else wp.vec3
    looked_up: Any = LOGS[channels, flicker]
    Keyframes: Any = make_keyframes(channels, flicker)
    Instances: Any = make_instances(channels)
    displacement = make_displacement(lens)
    note = make_note(channels)

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
        """Computes where [px] keyframe `which` shows the point that a pixel sees at instant i.

        body: that the point is on. away: its distance along the ray, in multiples of `spot.d`.
        """
        middle = wp.vec2(float(spot.x), float(spot.y))
        if which + i + spot.k == 0:
            return middle
        point = away * spot.d
        m = wp.vec3()
        if i == 0 or i > cut.slots:
            k = spot.k + wp.where(i == 0, 0, 1)
            row = which * cut.rows + wp.where(k == cut.coarse, 0, k) * cut.envs + spot.env
            m = keys.turn[row, body] * point + keys.shift[row, body]
        else:
            row = which * (stage.turn.shape[0] // 2) + slot_row(cut, spot, i)
            m = stage.turn[row, body] * point + stage.shift[row, body]
        near = wp.where(body == keys.turn.shape[1] - 1, 1.0e-6, view.near)
        return middle + displacement(view, spot.d, point, m, near)

    @wp.func
    def inside(view: CameraView, at: wp.vec2):
        """Tells whether all four pixels around a place are in the image."""
        return at[0] >= 0.0 and at[1] >= 0.0 and at[0] < float(view.width - 1) and at[1] < float(view.height - 1)

    @wp.func
    def between_pixels(view: CameraView, keys: Keyframes, base: int, at: wp.vec2, patch: int):
        """Interpolates ln I of a keyframe bilinearly; takes the nearest pixel's where not all four show the patch."""
        left = int(at[0])
        top = int(at[1])
        fx = at[0] - float(left)
        fy = at[1] - float(top)
        here = base + top * view.width + left
        below = here + view.width
        one = keys.patch[here] == patch and keys.patch[here + 1] == patch
        if one and keys.patch[below] == patch and keys.patch[below + 1] == patch:
            upper = (1.0 - fx) * keys.logs[here] + fx * keys.logs[here + 1]
            return (1.0 - fy) * upper + fy * ((1.0 - fx) * keys.logs[below] + fx * keys.logs[below + 1])
        return keys.logs[here + int(fy + 0.5) * view.width + int(fx + 0.5)]

    @wp.func
    def roughness(view: CameraView, keys: Keyframes, base: int, at: wp.vec2):
        """Computes the greatest difference of ln I between the four pixels around a place."""
        here = base + int(at[1]) * view.width + int(at[0])
        below = here + view.width
        a = keys.logs[here]
        b = keys.logs[here + 1]
        c = keys.logs[below]
        d = keys.logs[below + 1]
        return apart(wp.min(wp.min(a, b), wp.min(c, d)), wp.max(wp.max(a, b), wp.max(c, d)))

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
            patch = stage.targets.pieces[t][1]
            body = stage.targets.pieces[t][0]
            from_here = depth_of(before)
        base = keys.first[which] + spot.env * view.width * view.height
        each = (cut.slots + 1) // stage.probes[spot.env]
        here = place_then(view, cut, keys, stage, spot, which, start, body, from_here)
        nothing = pixel(UNKNOWN)
        if not inside(view, here):
            return last, nothing, False
        anchor = between_pixels(view, keys, base, here, patch)
        anchored = float(start)
        value = anchor
        then = anchored
        told = anchor
        listed = start
        gone = wp.float32(0.0)
        low = looked_up(-STEEPEST)
        high = looked_up(STEEPEST)
        i = start
        hit = before
        while i < end:
            following = wp.min(end, (i // each + 1) * each)
            seen = after
            if following < end:
                seen = entry_at(cut, stage, spot, following)
            away = from_here
            if t != MISS:
                away = depth_of(seen)
            there = place_then(view, cut, keys, stage, spot, which, following, body, away)
            if not inside(view, there):
                return last, nothing, False
            step = there - here
            length = wp.length(step)
            if length > LEAST_STEP or i > start:
                steps = wp.min(int(PER_PIXEL * length) + 1, MOST_STEPS)
                for n in range(1, steps + 1):
                    g = float(n) / float(steps)
                    at = here + g * step
                    if keys.patch[base + int(at[1] + 0.5) * view.width + int(at[0] + 0.5)] != patch:
                        return last, nothing, False
                    now = float(i) + g * float(following - i)
                    fresh = between_pixels(view, keys, base, at, patch)
                    slope = (fresh - anchor) / (now - anchored)
                    rough = wp.bool(False)
                    gone += length / float(steps)
                    if gone > ROUGH_STEP:
                        rough = roughness(view, keys, base, at) > cut.rough
                    if outside(slope, low, high) or rough:
                        # The sample before is the last one that a straight line reaches.
                        place = int(then + 0.5)
                        if place > listed and place < end:
                            rise = pixel(UNKNOWN)
                            if wp.static(not flicker):
                                rise = value - told
                            last = note(cut, instances, spot, place, hit, seen, rise, last, room, most, band, count)
                            told = value
                            listed = place
                        anchor = value
                        anchored = then
                        gone = wp.float32(0.0)
                        low = looked_up(-STEEPEST)
                        high = looked_up(STEEPEST)
                    over = 1.0 / (now - anchored)
                    bend = looked_up(cut.straight)
                    low = wp.max(low, (fresh - bend - anchor) * over)
                    high = wp.min(high, (fresh + bend - anchor) * over)
                    value = fresh
                    then = now
            here = there
            hit = seen
            i = following
        change = pixel(UNKNOWN)
        if wp.static(not flicker):
            change = value - told
        return last, change, True

    return walk
