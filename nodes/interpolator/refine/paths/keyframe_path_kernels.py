"""Follows the point that a pixel sees over a surface, looked up in a keyframe, and finds where ln I bends."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.image_kernels import pixel_type
from nodes.interpolator.refine.paths.keyframe_point_kernels import make_place_then, make_point_look_up
from nodes.interpolator.refine.paths.motion_kernels import stride_of
from nodes.interpolator.refine.samples.list_kernels import ListPart
from nodes.interpolator.refine.samples.request_kernels import UNKNOWN, make_request, make_requests
from nodes.interpolator.refine.window_kernels import (
    PixelInterval,
    Run,
    WindowParameters,
    WindowScene,
    entry_at,
    probe_spacing,
)
from nodes.interpolator.rigid.look_up.log_kernels import log_type
from nodes.interpolator.rigid.look_up.look_up_kernels import make_keyframes
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
STEEPEST = wp.constant(1.0e30)


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


@wp.func
def entries_about(
    params: WindowParameters,
    scene: WindowScene,
    px: PixelInterval,
    place: int,
    each: int,
    i: int,
    hit: wp.uint64,
    following: int,
    seen: wp.uint64,
):
    """Gives the z-buffer entries known before and after instant `place`, of `hit` at i and `seen` at `following`."""
    ahead = hit
    behind = seen
    if triangle_of(hit) != triangle_of(seen):
        # What is nearer in time tells more of what is between.
        probe = place // each * each
        if probe > i:
            ahead = entry_at(params, scene, px, probe)
        if probe + each < following:
            behind = entry_at(params, scene, px, probe + each)
    return ahead, behind


@cache
def make_request_keyframe_path(lens: str, channels: int, waveform_count: int) -> Any:
    """Makes the function `request_keyframe_path`; arguments as of make_look_up."""
    pixel = pixel_type(channels)
    looked_up: Any = log_type(channels, waveform_count)
    Keyframes: Any = make_keyframes(channels, waveform_count)
    Requests: Any = make_requests(channels)
    place_then, (in_view, look_up_at, _light_at) = (
        make_place_then(lens, channels, waveform_count),
        make_point_look_up(channels, waveform_count),
    )
    request = make_request(channels)

    @wp.func
    def request_keyframe_path(
        view: CameraView,
        params: WindowParameters,
        keys: Keyframes,
        scene: WindowScene,
        requests: Requests,
        px: PixelInterval,
        which: int,
        run: Run,
        out: ListPart,
    ):
        """Follows a pixel over the surface of a run in keyframe `which`, and lists the instants between which ln I is
        straight within params.straight.

        Gives the index of the last entry listed, the change of ln I since, and whether the keyframe shows all of the
        way.
        """
        last = run.last
        patch = wp.int32(0)
        body = keys.motions.shape[1] - 1
        from_here = wp.float32(1.0)
        t = triangle_of(run.before)
        if t != MISS:
            patch = patch_of(run.before, scene.targets.pieces[t])
            body = scene.targets.pieces[t][0]
            from_here = depth_of(run.before)
        base = keys.first[which] + px.env * view.width * view.height
        each = probe_spacing(params, scene, px.env)
        here = place_then(view, params, keys, scene, px, which, run.start, body, from_here)
        nothing = pixel(UNKNOWN)
        if not in_view(view, keys, base, here, t == MISS):
            return last, nothing, False
        _shown, anchor, _spread = look_up_at(view, keys, base, wp.vec2(here[0], here[1]), patch)
        anchored = float(run.start)
        value = anchor
        then = anchored
        told = anchor
        listed = run.start
        gone = wp.float32(0.0)
        bend = looked_up(params.straight)
        low = looked_up(-STEEPEST)
        high = looked_up(STEEPEST)
        stride = stride_of(params, scene, px, which, body, from_here)
        i = run.start
        hit = run.before
        while i < run.end:
            following = wp.int32(0)
            seen = run.after
            step = wp.vec3(0.0, 0.0, 0.0)
            length = wp.float32(0.0)
            settled = wp.bool(False)
            while not settled:
                # Both are powers of two.
                following = wp.min(run.end, (i | (stride - 1)) + 1)
                seen = run.after
                if following < run.end:
                    seen = entry_at(params, scene, px, following)
                away = from_here
                if t != MISS:
                    away = depth_of(seen)
                there = place_then(view, params, keys, scene, px, which, following, body, away)
                if not in_view(view, keys, base, there, t == MISS):
                    return last, nothing, False
                step = there - here
                length = wp.length(wp.vec2(step[0], step[1]))
                settled = length <= LONG or stride <= each
                if not settled:
                    stride = stride >> 1
            if length > LEAST_STEP or i > run.start:
                steps = wp.min(int(PER_PIXEL * length) + 1, MOST_STEPS)
                share = 1.0 / float(steps)
                pace = share * float(following - i)
                for n in range(1, steps + 1):
                    at = wp.vec2(here[0] + float(n) * share * step[0], here[1] + float(n) * share * step[1])
                    now = float(i) + float(n) * pace
                    shown, fresh, spread = look_up_at(view, keys, base, at, patch)
                    if not shown:
                        return last, nothing, False
                    gone += length * share
                    rough = gone > ROUGH_STEP and spread > params.rough
                    rise = fresh - anchor
                    if outside(rise, (now - anchored) * low, (now - anchored) * high) or rough:
                        # The sample before is the last one that a straight line reaches.
                        place = int(then + 0.5)
                        if place > listed and place < run.end:
                            change = pixel(UNKNOWN)
                            if wp.static(waveform_count == 0):
                                change = value - told
                            ahead, behind = entries_about(params, scene, px, place, each, i, hit, following, seen)
                            last = request(params, requests, px, place, ahead, behind, change, last, out)
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
        if wp.static(waveform_count == 0):
            change = value - told
        return last, change, True

    return request_keyframe_path
