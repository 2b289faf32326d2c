"""Chooses the instants at which pixels are evaluated because light flickers."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.image_kernels import pixel_type
from nodes.interpolator.refine.paths.keyframe_path_kernels import STEEPEST, outside
from nodes.interpolator.refine.samples.list_kernels import ListPart
from nodes.interpolator.refine.samples.request_kernels import PARTS, PREDICTED, make_request, make_requests
from nodes.interpolator.refine.window_kernels import (
    PixelInterval,
    WindowParameters,
    WindowScene,
    entry_at,
    probe_spacing,
    slot_row,
)
from nodes.interpolator.rigid.keyframe_kernels import log_of
from nodes.interpolator.rigid.look_up.log_kernels import apart, make_radiance_of
from nodes.interpolator.rigid.look_up.look_up_kernels import make_keyframes
from nodes.renderer.raster.depth_kernels import NO_ENTRY

wp.set_module_options({"enable_backward": False})

MARKED = wp.constant(0.5)
"""Part of the distance of ln I from a straight line up to which a mark is passed over: light that hardly changes, of
lamps that make up for each other, crosses thresholds slowly, and what it is off by is a long time."""


@wp.struct
class Marks:
    """Holds the marks of a gap, and how strong the lights are whose radiance is added up.

    first [E or 1, K + 1]: where the marks of a coarse interval begin. at: instant within it, counted from 1. later: how
    much later than that they are, in PARTS. Strengths: at_start [E waveforms], at the gap's start; at_frames
    [rows waveforms], at the coarse frames; within [slots E waveforms], at the instants of the window.
    """

    first: wp.array2d(dtype=int)
    at: wp.array(dtype=int)
    later: wp.array(dtype=int)
    at_start: wp.array(dtype=float)
    at_frames: wp.array(dtype=float)
    within: wp.array(dtype=float)


@wp.func
def marks_of(marks: Marks, px: PixelInterval):
    """Gives where the marks of a coarse interval begin and end."""
    row = wp.min(px.env, marks.first.shape[0] - 1)
    return marks.first[row, px.k], marks.first[row, px.k + 1]


@wp.func
def entry_near(params: WindowParameters, scene: WindowScene, px: PixelInterval, i: int, start: int, before: wp.uint64):
    """Gives what a run that began at instant `start` with the entry `before` showed last, up to instant i."""
    each = probe_spacing(params, scene, px.env)
    probe = i // each * each
    if probe <= start:
        return before
    return entry_at(params, scene, px, probe)


@cache
def make_request_marks(channels: int, waveform_count: int) -> Any:
    """Makes the function `request_marks`; arguments as of `log_type`."""
    pixel = pixel_type(channels)
    Keyframes: Any = make_keyframes(channels, waveform_count)
    Requests: Any = make_requests(channels)
    request, radiance_of = make_request(channels), make_radiance_of(channels, waveform_count)

    @wp.func
    def request_marks(
        params: WindowParameters,
        keys: Keyframes,
        requests: Requests,
        marks: Marks,
        px: PixelInterval,
        at: int,
        hit: wp.uint64,
        log_a: pixel,
        log_b: pixel,
        out: ListPart,
    ):
        """Lists those marks of a pixel that shows the same point all along, in light that changes by flicker alone,
        between which ln I is on a straight line.

        at: of the pixel in keyframe B. log_a, log_b: ln I at the start and at the end. Gives the place of the last one,
        -1 without any, and by how much ln I changes from there, or else from the start, to the end, as the lights'
        strength alone tells: what has changed otherwise shows beside it.
        """
        first, end = marks_of(marks, px)
        logs = keys.logs[keys.first[1] + at]
        after = wp.where(px.k + 1 == params.coarse, 0, px.k + 1)
        base = log_b - log_of(radiance_of(logs, marks.at_frames, after * params.envs + px.env))
        last = wp.int32(-1)
        anchor = base
        if px.k > 0:
            anchor += log_of(radiance_of(logs, marks.at_frames, px.k * params.envs + px.env))
        else:
            anchor += log_of(radiance_of(logs, marks.at_start, px.env))
        told = apart(anchor, log_a) <= params.bend
        seen = hit
        if told:
            seen = NO_ENTRY
        anchored = wp.float32(0.0)
        value = anchor
        then = wp.float32(0.0)
        low = pixel(-STEEPEST)
        high = pixel(STEEPEST)
        for n in range(first, end + 1):
            now = float(params.slots + 1)
            fresh = log_b
            if n < end:
                i = marks.at[n]
                now = float(i) + float(marks.later[n]) / float(PARTS)
                fresh = base + log_of(radiance_of(logs, marks.within, slot_row(params, px.env, px.k, i)))
            if outside(fresh - anchor, (now - anchored) * low, (now - anchored) * high):
                last = request(params, requests, px, marks.at[n - 1], seen, seen, value - anchor, last, out)
                if told:
                    requests.rise[last] = value
                    requests.shown[last] = PREDICTED
                requests.later[last] = marks.later[n - 1]
                anchor = value
                anchored = then
                low = pixel(-STEEPEST)
                high = pixel(STEEPEST)
            over = 1.0 / (now - anchored)
            bend = pixel(MARKED * params.straight)
            low = wp.max(low, (fresh - bend - anchor) * over)
            high = wp.min(high, (fresh + bend - anchor) * over)
            value = fresh
            then = now
        return last, log_b - anchor

    return request_marks
