"""Lists the samples that pixels need: at both ends of each run of one surface, and where ln I bends along it."""

from functools import cache
from typing import Any

import warp as wp

from evis.gpu.append_kernels import take_place
from nodes.interpolator.refine.change_kernels import SHARP, Changes, ends_of, spot_of
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
from nodes.interpolator.rigid.keyframe_kernels import equal, log_of
from nodes.interpolator.rigid.log_kernels import apart, radiance_of
from nodes.interpolator.rigid.look_up_kernels import make_keyframes
from nodes.interpolator.rigid.plan_kernels import joined
from nodes.renderer.raster.view_kernels import CameraView

wp.set_module_options({"enable_backward": False})


@cache
def make_find_runs(lens: str, channels: int, flicker: bool) -> tuple[wp.Kernel, wp.Kernel]:
    """Makes the kernels `find_plain` and `find_runs`, of pixels that show one surface all along, and of all others;
    arguments as of make_look_up."""
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
        within: wp.array(dtype=float),
    ):
        """Finds the instant at which light that flickers has a pixel furthest off a straight line; 0 where it is not
        off by more than cut.bend. at: of the pixel in keyframe B."""
        worst = cut.bend
        place = wp.int32(0)
        logs = keys.logs[keys.first[1] + at]
        after = wp.where(spot.k + 1 == cut.coarse, 0, spot.k + 1)
        end = log_of(radiance_of(logs, strength[after * cut.envs + spot.env]))
        for n in range(1, cut.looks):
            i = n * (cut.slots + 1) // cut.looks
            value = log_b + log_of(radiance_of(logs, within[slot_row(cut, spot, i)])) - end
            off = apart(value, log_a + float(n) / float(cut.looks) * (log_b - log_a))
            if off > worst:
                worst = off
                place = i
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
        nearer = wp.where(2 * spot.k >= cut.coarse and spot.k > 0, 1, 0)
        new = last
        rise = pixel(UNKNOWN)
        whole = wp.bool(False)
        tries = wp.int32(0)
        while tries < 2 and not whole and new == last and (tries == 0 or spot.k + start > 0):
            which = wp.where(tries == 0, nearer, 1 - nearer)
            new, rise, whole = walk(
                view, cut, keys, stage, instances, spot, which, start, end, before, after, last, room, most, band, count
            )
            tries += 1
        return new, rise, whole

    @wp.kernel(module="unique", enable_backward=False)
    def find_plain(
        # in
        view: CameraView,
        cut: Cut,
        row0: int,
        span: int,
        room: int,
        most: int,
        others0: int,
        band: int,
        held: wp.array(dtype=int),
        keys: Keyframes,
        stage: Stage,
        strength: wp.array(dtype=float),
        within: wp.array(dtype=float),
        image: wp.array3d(dtype=pixel),
        start: wp.array3d(dtype=wp.uint64),
        frames: wp.array3d(dtype=pixel),
        # out
        instances: Instances,
        count: wp.array(dtype=int),
        others: wp.array(dtype=int),
        others_count: wp.array(dtype=int),
    ):
        """Lists the instants at which pixels are to be looked at that show one surface at both ends of a coarse
        interval and at all probes, from `room` on, `most` at most; count[band]: how many there would be. What shows
        several is listed in `others`, from others0 on, as indices into [intervals, E, h, w].

        strength [rows], within [slots E]: of lights that flicker, at coarse frames and within. image, start: keyframe A
        and its z-buffer, with the margin. frames: [E K, h, w].
        """
        n, row, part = wp.tid()
        env = n % cut.envs
        k = cut.first + n // cut.envs
        if held[env] == 1:
            return
        y = row0 + row
        each = cut.slots + 1
        for x in range(part * span, wp.min(part * span + span, cut.width)):
            spot = spot_of(view, cut, k, (env * cut.height + y) * cut.width + x)
            ends = ends_of(cut, stage, start, spot)
            one = wp.bool(True)
            changed = ends.before != ends.after
            hit = ends.before
            probes = stage.probes[env]
            for i in range(1, probes + 1):
                then = ends.after
                if i < probes:
                    then = entry_at(cut, stage, spot, i * each // probes)
                one = one and joined(hit, then, stage.targets.pieces)
                hit = then
            a = wp.where(k == 0, image[env, spot.y, spot.x], frames[env * cut.coarse + wp.max(k - 1, 0), y, x])
            b = frames[env * cut.coarse + k, y, x]
            if not one:
                others[others0 + take_place(others_count, band)] = (
                    n // cut.envs * (cut.envs * cut.height * cut.width) + spot.q
                )
            elif changed or not equal(a, b) or wp.static(flicker):
                log_a = log_of(a)
                log_b = log_of(b)
                place = wp.int32(0)
                if wp.static(flicker):
                    at_b = (env * view.height + spot.y) * view.width + spot.x
                    place = flickers(cut, keys, spot, at_b, log_a, log_b, strength, within)
                last = wp.int32(-1)
                rise = pixel(UNKNOWN)
                whole = wp.bool(True)
                if changed or not equal(a, b):
                    last, rise, whole = go(
                        view, cut, keys, stage, instances, spot, 0, each, ends.before, ends.after, last, room, most,
                        band, count,
                    )  # fmt: skip
                    if last < 0 and place == 0 and apart(log_a, log_b) > cut.jump:
                        if not whole or apart(rise, log_b - log_a) > cut.bend:
                            place = each // 2
                if last < 0 and place > 0:
                    rise = pixel(UNKNOWN)
                    last = note(
                        cut, instances, spot, place, ends.before, ends.after, rise, last, room, most, band, count
                    )
                if last >= 0:
                    instances.tail[last] = rise
                    instances.ends[last] = 1

    @wp.kernel(module="unique", enable_backward=False)
    def find_runs(
        # in
        view: CameraView,
        cut: Cut,
        workers: int,
        room: int,
        most: int,
        others0: int,
        band: int,
        others: wp.array(dtype=int),
        others_count: wp.array(dtype=int),
        changes: Changes,
        keys: Keyframes,
        stage: Stage,
        start: wp.array3d(dtype=wp.uint64),
        # in or out
        instances: Instances,
        count: wp.array(dtype=int),
    ):
        """Lists the instants at which pixels are to be looked at that show one surface after the other; arguments as of
        `find_plain`."""
        each = cut.slots + 1
        inner = cut.envs * cut.height * cut.width
        j = wp.tid()
        while j < others_count[band]:
            at = others[others0 + j]
            spot = spot_of(view, cut, cut.first + at // inner, at % inner)
            ends = ends_of(cut, stage, start, spot)
            last = wp.int32(-1)
            none = pixel(UNKNOWN)
            # The present run: the instant at which it began, and the z-buffer entry there.
            begun = wp.int32(0)
            seen = ends.before
            for n in range(stage.probes[spot.env]):
                c = changes.first[(others0 + j) * cut.probes + n]
                while c >= 0:
                    # One surface ends at `low`, the next begins at `high`.
                    low = changes.low[c]
                    high = low + 1
                    hit = changes.before[c]
                    then = changes.after[c]
                    later = changes.later[c]
                    if low > begun:
                        last, rise, _whole = go(
                            view, cut, keys, stage, instances, spot, begun, low, seen, hit, last, room, most, band,
                            count,
                        )  # fmt: skip
                        last = note(cut, instances, spot, low, hit, hit, rise, last, room, most, band, count)
                    if later > 0:
                        instances.later[last] = later - SHARP
                    begun = high
                    seen = then
                    if high <= cut.slots:
                        last = note(cut, instances, spot, high, then, then, none, last, room, most, band, count)
                        if later > 0:
                            instances.later[last] = later + SHARP - PARTS
                    c = changes.following[c]
            if last >= 0:
                if begun <= cut.slots:
                    last, rise, _whole = go(
                        view, cut, keys, stage, instances, spot, begun, each, seen, ends.after, last, room, most, band,
                        count,
                    )  # fmt: skip
                    instances.tail[last] = rise
                instances.ends[last] = 1
            j += workers

    return find_plain, find_runs
