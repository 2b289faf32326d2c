"""Intervals of single pixels between two of their samples: which are cut, where, and which are straight."""

from functools import cache
from typing import Any

import warp as wp

from evis.gpu.append_kernels import take_place
from nodes.interpolator.refine.sight_kernels import Targets, seen_between
from nodes.interpolator.refine.suspect_kernels import Cut, make_suspicions, probed
from nodes.interpolator.rigid.keyframe_kernels import equal, log_of
from nodes.interpolator.rigid.log_kernels import apart
from nodes.interpolator.rigid.look_up_kernels import make_keyframes
from nodes.interpolator.rigid.plan_kernels import joined
from nodes.renderer.raster.view_kernels import CameraView, pixel_ray

wp.set_module_options({"enable_backward": False})

STRAIGHT = wp.constant(0.5)
"""Part of the bend up to which what a keyframe shows of an interval is taken for a straight line."""
LENGTHS = wp.constant(1 << 15)
"""More than the instants of a coarse interval."""


@cache
def make_intervals(channels: int) -> Any:
    """Makes the struct of a list of intervals; channels: 1 (luminance) or 3 (RGB).

    at: the instant at which it is cut and the pixel, index into [slots, E, h, w]. ends: LENGTHS times the instant of
    its start, counted from that of its coarse interval, plus that of its end. first, last: ln of radiance at its ends;
    before, after: z-buffer entries there.
    """
    pixel: Any = wp.float32 if channels == 1 else wp.vec3

    class Intervals:
        at: wp.array(dtype=int)
        ends: wp.array(dtype=int)
        first: wp.array(dtype=pixel)
        last: wp.array(dtype=pixel)
        before: wp.array(dtype=wp.uint64)
        after: wp.array(dtype=wp.uint64)

    Intervals.__qualname__ = f"Intervals{channels}"
    return wp.struct(Intervals)


@cache
def make_rounds(lens: str, channels: int, flicker: bool) -> tuple[wp.Kernel, wp.Kernel, wp.Kernel]:
    """Makes the kernels `begin`, `see` and `split`; arguments as of make_look_up."""
    pixel: Any = wp.float32 if channels == 1 else wp.vec3
    flickers, bend_of = make_suspicions(lens, channels, flicker)
    Keyframes: Any = make_keyframes(channels, flicker)
    Intervals: Any = make_intervals(channels)

    @wp.func
    def put(
        intervals: Intervals,
        place: int,
        at: int,
        low: int,
        high: int,
        first: pixel,
        last: pixel,
        before: wp.uint64,
        after: wp.uint64,
    ):
        """Writes an interval into a list."""
        intervals.at[place] = at
        intervals.ends[place] = low * LENGTHS + high
        intervals.first[place] = first
        intervals.last[place] = last
        intervals.before[place] = before
        intervals.after[place] = after

    @wp.kernel(module="unique", enable_backward=False)
    def begin(
        # in
        view: CameraView,
        cut: Cut,
        row0: int,
        span: int,
        window: wp.vec2i,
        coarse: int,
        room: int,
        band: int,
        held: wp.array(dtype=int),
        pieces: wp.array(dtype=wp.vec2i),
        keys: Keyframes,
        strength: wp.array(dtype=float),
        image: wp.array3d(dtype=pixel),
        start: wp.array3d(dtype=wp.uint64),
        packed: wp.array3d(dtype=wp.uint64),
        frames: wp.array3d(dtype=pixel),
        # out
        intervals: Intervals,
        count: wp.array(dtype=int),
    ):
        """Lists the coarse intervals window[0] .. window[1] - 1 that are to be cut, from `room` on.

        coarse: frames of the gap. strength [rows]: of lights that flicker. image, start: keyframe A and its z-buffer,
        with the margin. packed [rows, H, W]: z-buffers of B, of the sub-frames 1 .. K - 1, and of the probes. frames:
        [E K, h, w].
        """
        env, row, part = wp.tid()
        if held[env] == 1:
            return
        y = row0 + row
        m = cut.margin
        inner = cut.envs * cut.height * cut.width
        for x in range(part * span, wp.min(part * span + span, cut.width)):
            a = image[env, y + m, x + m]
            before = start[env, y + m, x + m]
            if window[0] > 0:
                a = frames[env * coarse + window[0] - 1, y, x]
                before = packed[window[0] * cut.envs + env, y + m, x + m]
            log_a = log_of(a)
            for k in range(window[0], window[1]):
                slot = wp.where(k + 1 == coarse, 0, k + 1)
                b = frames[env * coarse + k, y, x]
                after = packed[slot * cut.envs + env, y + m, x + m]
                log_b = log_a
                if not equal(a, b):
                    log_b = log_of(b)
                taken = wp.bool(False)
                place = (cut.slots + 1) // 2
                if not equal(a, b) or before != after:
                    taken = apart(log_a, log_b) > cut.jump
                    if joined(before, after, pieces):
                        bend, where, known = bend_of(
                            view, cut, keys, k, coarse, env, x + m, y + m, log_b - log_a, before, after, pieces
                        )
                        if known and taken:
                            taken = bend > STRAIGHT * cut.bend
                        if bend > cut.bend:
                            taken = True
                            place = wp.clamp(int(where * float(cut.slots + 1) + 0.5), 1, cut.slots)
                    else:
                        taken = True
                if wp.static(flicker):
                    at_b = (env * view.height + y + m) * view.width + x + m
                    lit_then = flickers(cut, keys, k, coarse, env, at_b, log_a, log_b, strength)
                    if lit_then > 0:
                        taken = True
                        place = lit_then
                third = probed(cut, coarse, k, env, x, y, 0, cut.slots + 1, before, after, pieces, packed)
                if third > 0:
                    taken = True
                    place = third
                if taken:
                    at = ((k - window[0]) * cut.slots + place - 1) * inner
                    at += (env * cut.height + y) * cut.width + x
                    to = room + take_place(count, band)
                    put(intervals, to, at, 0, cut.slots + 1, log_a, log_b, before, after)
                a = b
                log_a = log_b
                before = after

    @wp.kernel(module="unique", enable_backward=False)
    def see(
        # in
        view: CameraView,
        cut: Cut,
        first_interval: int,
        coarse: int,
        first: int,
        last: int,
        workers: int,
        packed: wp.array3d(dtype=wp.uint64),
        targets: Targets,
        intervals: Intervals,
        # out
        hits: wp.array(dtype=wp.uint64),
    ):
        """Finds what is seen where intervals first .. last - 1 are cut, as z-buffer entries.

        first_interval: the first coarse interval of the slots. coarse, packed: as of `begin`.
        """
        j = first + wp.tid()
        while j < last:
            at = intervals.at[j]
            x = at % cut.width + cut.margin
            y = at // cut.width % cut.height + cut.margin
            n = at // (cut.width * cut.height)
            slot = n // cut.envs
            place = slot % cut.slots + 1
            probe = place * cut.probes // (cut.slots + 1)
            if place * cut.probes == probe * (cut.slots + 1):
                k = first_interval + slot // cut.slots
                hits[j] = packed[(coarse + k * (cut.probes - 1) + probe - 1) * cut.envs + n % cut.envs, y, x]
            else:
                d = pixel_ray(view, x, y)
                hits[j] = seen_between(view, targets, n, d, intervals.before[j], intervals.after[j])
            j += workers

    @wp.kernel(module="unique", enable_backward=False)
    def split(
        # in
        cut: Cut,
        base: int,
        coarse: int,
        first: int,
        last: int,
        workers: int,
        known: int,
        room: int,
        band: int,
        pieces: wp.array(dtype=wp.vec2i),
        packed: wp.array3d(dtype=wp.uint64),
        hits: wp.array(dtype=wp.uint64),
        radiance: wp.array(dtype=pixel),
        intervals: Intervals,
        # out
        pixels: wp.array(dtype=int),
        instants: wp.array(dtype=int),
        values: wp.array(dtype=pixel),
        halves: Intervals,
        count: wp.array(dtype=int),
    ):
        """Notes where intervals first .. last - 1 were cut, of that radiance, as samples, from
        `known` on, and lists their parts that are to be cut, from `room` on.

        base: instant of the slot before the first one. coarse, packed: as of `begin`.
        """
        j = first + wp.tid()
        inner = cut.envs * cut.height * cut.width
        while j < last:
            at = intervals.at[j]
            slot = at // inner
            middle = radiance[j]
            pixels[known + j - first] = at % inner
            # A coarse instant lies between the slots of two coarse intervals.
            instants[known + j - first] = base + slot + 1 + slot // cut.slots
            values[known + j - first] = middle
            low = intervals.ends[j] // LENGTHS
            high = intervals.ends[j] % LENGTHS
            place = slot % cut.slots + 1
            log_a = intervals.first[j]
            log_b = intervals.last[j]
            before = intervals.before[j]
            after = intervals.after[j]
            now = hits[j]
            log_m = log_of(middle)
            share = float(place - low) / float(high - low)
            bent = apart(log_m, log_a + share * (log_b - log_a)) > cut.bend
            if not bent and (apart(log_a, log_b) > cut.jump or high - low > cut.blind):
                bent = not joined(before, after, pieces)
            q = at % inner
            k = (base + slot + slot // cut.slots) // (cut.slots + 1)
            x = q % cut.width
            y = q // cut.width % cut.height
            env = q // (cut.width * cut.height)
            for side in range(2):
                start = wp.where(side == 0, low, place)
                end = wp.where(side == 0, place, high)
                ahead = wp.where(side == 0, before, now)
                behind = wp.where(side == 0, now, after)
                if end > start + 1:
                    middle_of = (start + end) // 2
                    step = apart(log_a, log_m)
                    if side == 1:
                        step = apart(log_m, log_b)
                    taken = bent and (step > cut.jump or not joined(ahead, behind, pieces))
                    third = probed(cut, coarse, k, env, x, y, start, end, ahead, behind, pieces, packed)
                    if third > 0:
                        taken = True
                        middle_of = third
                    if taken:
                        to = room + take_place(count, band)
                        at_next = at + (middle_of - place) * inner
                        if side == 0:
                            put(halves, to, at_next, start, end, log_a, log_m, ahead, behind)
                        else:
                            put(halves, to, at_next, start, end, log_m, log_b, ahead, behind)
            j += workers

    return begin, see, split
