"""What a pixel shows between two coarse samples, run by run of one surface: the instants to look at it, all at once."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.refine.path_kernels import (
    PARTS,
    UNKNOWN,
    Cut,
    Spot,
    Stage,
    entry_at,
    make_instances,
    make_note,
    make_walk,
    slot_row,
)
from nodes.interpolator.refine.sight_kernels import passing, seen_between
from nodes.interpolator.rigid.keyframe_kernels import equal, log_of
from nodes.interpolator.rigid.log_kernels import apart, radiance_of
from nodes.interpolator.rigid.look_up_kernels import make_keyframes
from nodes.interpolator.rigid.plan_kernels import joined
from nodes.renderer.raster.view_kernels import CameraView, pixel_ray

wp.set_module_options({"enable_backward": False})

PENDING = wp.types.vector(length=12, dtype=wp.int32)
SEEN_THEN = wp.types.vector(length=12, dtype=wp.uint64)
"""Ends of halves of an interval between probes that are still to be looked at: as often as it can be halved."""

SHARP = wp.constant(2)
"""Half of the time that one surface takes to give way to the next, in PARTS."""


@cache
def make_find_runs(lens: str, channels: int, flicker: bool) -> wp.Kernel:
    """Makes the kernel `find_runs`; arguments as of make_look_up."""
    pixel: Any = wp.float32 if channels == 1 else wp.vec3
    Keyframes: Any = make_keyframes(channels, flicker)
    Instances: Any = make_instances(channels)
    walk, note = make_walk(lens, channels, flicker), make_note(channels)

    @wp.func
    def flickers(
        cut: Cut,
        keys: Keyframes,
        spot: Spot,
        at: int,
        log_a: pixel,
        log_b: pixel,
        strength: wp.array(dtype=float),
    ):
        """Finds the probe at which light that flickers has a pixel furthest off a straight line, and the instant; 0
        where it is not off by more than cut.bend. at: of the pixel in keyframe B."""
        worst = cut.bend
        place = wp.int32(0)
        logs = keys.logs[keys.first[1] + at]
        after = wp.where(spot.k + 1 == cut.coarse, 0, spot.k + 1)
        end = log_of(radiance_of(logs, strength[after * cut.envs + spot.env]))
        for n in range(1, cut.probes):
            row = (cut.coarse + spot.k * (cut.probes - 1) + n - 1) * cut.envs + spot.env
            value = log_b + log_of(radiance_of(logs, strength[row])) - end
            off = apart(value, log_a + float(n) / float(cut.probes) * (log_b - log_a))
            if off > worst:
                worst = off
                place = n * (cut.slots + 1) // cut.probes
        return place

    @wp.func
    def go(
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
        """Does as `walk` does, in the nearer keyframe, or in the other one where that does not show the way."""
        which = wp.where(2 * spot.k >= cut.coarse and spot.k > 0, 1, 0)
        new, rise, whole = walk(
            view, cut, keys, stage, instances, spot, which, start, end, before, after, last, room, most, band, count
        )
        if not whole and new == last and spot.k + start > 0:
            new, rise, whole = walk(
                view, cut, keys, stage, instances, spot, 1 - which, start, end, before, after, last, room, most, band,
                count,
            )  # fmt: skip
        return new, rise, whole

    @wp.kernel(module="unique", enable_backward=False)
    def find_runs(
        # in
        view: CameraView,
        cut: Cut,
        row0: int,
        span: int,
        last_interval: int,
        room: int,
        most: int,
        band: int,
        held: wp.array(dtype=int),
        keys: Keyframes,
        stage: Stage,
        strength: wp.array(dtype=float),
        image: wp.array3d(dtype=pixel),
        start: wp.array3d(dtype=wp.uint64),
        frames: wp.array3d(dtype=pixel),
        # out
        instances: Instances,
        count: wp.array(dtype=int),
    ):
        """Lists the instants at which pixels are to be looked at in the coarse intervals cut.first .. last_interval -
        1, from `room` on, `most` at most; count[band]: how many there would be.

        strength [rows]: of lights that flicker. image, start: keyframe A and its z-buffer, with the margin. frames: [E
        K, h, w].
        """
        env, row, part = wp.tid()
        if held[env] == 1:
            return
        m = cut.margin
        each = cut.slots + 1
        spot = Spot()
        spot.env = env
        spot.y = row0 + row + m
        y = row0 + row
        for x in range(part * span, wp.min(part * span + span, cut.width)):
            spot.x = x + m
            spot.q = (env * cut.height + y) * cut.width + x
            spot.d = pixel_ray(view, spot.x, spot.y)
            a = image[env, spot.y, spot.x]
            before = start[env, spot.y, spot.x]
            if cut.first > 0:
                a = frames[env * cut.coarse + cut.first - 1, y, x]
                before = stage.packed[cut.first * cut.envs + env, spot.y, spot.x]
            log_a = log_of(a)
            for k in range(cut.first, last_interval):
                spot.k = k
                slot = wp.where(k + 1 == cut.coarse, 0, k + 1)
                b = frames[env * cut.coarse + k, y, x]
                after = stage.packed[slot * cut.envs + env, spot.y, spot.x]
                log_b = log_a
                if not equal(a, b):
                    log_b = log_of(b)
                last = wp.int32(-1)
                # The run so far: where it began, and what was seen there.
                begun = wp.int32(0)
                seen = before
                low = wp.int32(0)
                hit = before
                for n in range(1, cut.probes + 1):
                    high = n * each // cut.probes
                    then = after
                    if n < cut.probes:
                        then = entry_at(cut, stage, spot, high)
                    if joined(hit, then, stage.targets.pieces):
                        low = high
                        hit = then
                    else:
                        pending = PENDING()
                        entries = SEEN_THEN()
                        pending[0] = high
                        entries[0] = then
                        waiting = wp.int32(0)
                        while waiting >= 0:
                            high = pending[waiting]
                            then = entries[waiting]
                            if joined(hit, then, stage.targets.pieces):
                                low = high
                                hit = then
                                waiting -= 1
                            elif high - low > 1:
                                middle = (low + high) // 2
                                row_then = slot_row(cut, spot, middle)
                                waiting += 1
                                pending[waiting] = middle
                                entries[waiting] = seen_between(view, stage.targets, row_then, spot.d, hit, then)
                            else:
                                # One surface ends at `low`, the next begins at `high`.
                                rise = pixel(UNKNOWN)
                                if low > begun:
                                    last, rise, _whole = go(
                                        view, cut, keys, stage, instances, spot, begun, low, seen, hit, last, room,
                                        most, band, count,
                                    )  # fmt: skip
                                if low > 0 and low > begun:
                                    last = note(cut, instances, spot, low, hit, rise, last, room, most, band, count)
                                later = wp.int32(0)
                                if low > 0 and high <= cut.slots:
                                    row_low = slot_row(cut, spot, low)
                                    row_high = slot_row(cut, spot, high)
                                    f = passing(view, stage.targets, row_low, row_high, spot.d, hit, then)
                                    later = int(f * float(PARTS))
                                    later = wp.clamp(later, SHARP, PARTS - SHARP)
                                    instances.later[last] = later - SHARP
                                begun = high
                                seen = then
                                if high <= cut.slots:
                                    none = pixel(UNKNOWN)
                                    last = note(cut, instances, spot, high, then, none, last, room, most, band, count)
                                    if later > 0:
                                        instances.later[last] = later + SHARP - PARTS
                                low = high
                                hit = then
                                waiting -= 1
                place = wp.int32(0)
                if wp.static(flicker):
                    at_b = (env * view.height + spot.y) * view.width + spot.x
                    place = flickers(cut, keys, spot, at_b, log_a, log_b, strength)
                if begun <= cut.slots and (begun > 0 or before != after or not equal(a, b)):
                    whole = wp.bool(True)
                    rise = pixel(UNKNOWN)
                    last, rise, whole = go(
                        view, cut, keys, stage, instances, spot, begun, each, seen, after, last, room, most, band, count
                    )
                    if last >= 0:
                        instances.tail[last] = rise
                    elif apart(log_a, log_b) > cut.jump and place == 0:
                        if not whole or apart(rise, log_b - log_a) > cut.bend:
                            place = each // 2
                if last < 0 and place > 0:
                    entry = seen_between(view, stage.targets, slot_row(cut, spot, place), spot.d, before, after)
                    last = note(cut, instances, spot, place, entry, pixel(UNKNOWN), last, room, most, band, count)
                if last >= 0:
                    instances.ends[last] = 1
                a = b
                log_a = log_b
                before = after

    return find_runs
