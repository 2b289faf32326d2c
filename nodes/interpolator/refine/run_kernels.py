"""Lists the samples that pixels need: at both ends of each run of one surface, and where ln I bends along it.

`find_plain` does the pixels that show one surface all along. Those that show several are listed, and so are their
changes from one to the next; `find_ends` lists the samples at these, and then `find_runs` those of each run by itself,
for some pixels have many runs, and a GPU waits for the slowest of its threads.
"""

from functools import cache
from typing import Any

import warp as wp

from evis.gpu.append_kernels import take_place
from nodes.interpolator.refine.along_kernels import make_through, make_untold
from nodes.interpolator.refine.change_kernels import Changes, Several
from nodes.interpolator.refine.light.flicker_kernels import Marks, make_note_marks
from nodes.interpolator.refine.path_kernels import (
    PARTS,
    SHARP,
    UNKNOWN,
    make_instances,
    make_note,
)
from nodes.interpolator.refine.stage_kernels import (
    FEW_REGISTERS,
    Cut,
    Stage,
    ends_of,
    shows_one,
    spot_at,
    spot_of,
)
from nodes.interpolator.refine.way_kernels import moves
from nodes.interpolator.relight.change_kernels import Change
from nodes.interpolator.relight.features import LightChanges
from nodes.interpolator.rigid.keyframe_kernels import equal, log_of
from nodes.interpolator.rigid.look_up.look_up_kernels import make_keyframes
from nodes.renderer.raster.depth_kernels import MISS, triangle_of
from nodes.renderer.raster.lens.view_kernels import CameraView

wp.set_module_options({"enable_backward": False})


@cache
def make_find_runs(
    lens: str, channels: int, flicker: bool, relit: bool, painted: bool, changes: LightChanges
) -> tuple[wp.Kernel, wp.Kernel, wp.Kernel]:
    """Makes the kernels `find_plain`, `find_ends` and `find_runs`; arguments as of make_look_up.

    relit: whether lights flicker each in its own way: then surfaces are shaded anew. painted: whether anything has a
    texture or colours at vertices. changes: of light in the scene.
    """
    pixel: Any = wp.float32 if channels == 1 else wp.vec3
    Keyframes: Any = make_keyframes(channels, flicker)
    Instances: Any = make_instances(channels)
    note, note_marks = make_note(channels), make_note_marks(channels)
    through = make_through(lens, channels, flicker, relit, painted, changes)
    untold = make_untold(channels, changes)

    @wp.kernel(module="unique", enable_backward=False, cuda_max_registers=FEW_REGISTERS)
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
        marks: Marks,
        change: Change,
        strength: wp.array(dtype=float),
        within: wp.array(dtype=float),
        image: wp.array3d(dtype=pixel),
        start: wp.array3d(dtype=wp.uint64),
        frames: wp.array3d(dtype=pixel),
        # out
        instances: Instances,
        count: wp.array(dtype=int),
        several: Several,
        others_count: wp.array(dtype=int),
    ):
        """Lists the instants at which pixels are to be looked at that show one surface at both ends of a coarse
        interval and at all probes, from `room` on, `most` at most; count[band]: how many there would be. What shows
        several is listed in `several`, from others0 on.

        marks: of lights that flicker; strength [rows], within [slots E]: how strong they are at coarse frames and
        within. image, start: keyframe A and its z-buffer, with the margin. frames: [E K, h, w].
        """
        n, row, part = wp.tid()
        env = n % cut.envs
        k = cut.first + n // cut.envs
        if held[env] == 1:
            return
        y = row0 + row
        each = cut.slots + 1
        for x in range(part * span, wp.min(part * span + span, cut.width)):
            spot = spot_at(view, cut, env, k, y, x)
            ends = ends_of(cut, stage, start, spot)
            one = shows_one(cut, stage, spot, ends.before, ends.after)
            changed = wp.bool(ends.before != ends.after)
            if one and not changed:
                # It may have come back, or be as far on as what is painted on it repeats.
                changed = moves(cut, stage, spot, ends.before)
            a = wp.where(k == 0, image[env, spot.y, spot.x], frames[env * cut.coarse + wp.max(k - 1, 0), y, x])
            b = frames[env * cut.coarse + k, y, x]
            if wp.static(changes.passes):
                if one and not changed and cut.parts > 0:
                    changed = stage.passing[n, y, x] != wp.uint64(0)
            done = wp.bool(False)
            whole = wp.bool(True)
            last = wp.int32(-1)
            rise = pixel(UNKNOWN)
            grown = pixel(0.0)
            if wp.static(flicker):
                if one and not changed:
                    done = True
                    at_b = (env * view.height + spot.y) * view.width + spot.x
                    last, rise = note_marks(
                        cut, keys, instances, marks, spot, at_b, ends.after, log_of(a), log_of(b), strength, within,
                        room, most, band, count,
                    )  # fmt: skip
                    if last >= 0:
                        instances.tail[last] = rise
                        instances.ends[last] = 1
            if not one:
                several.at[others0 + take_place(others_count, band)] = (
                    n // cut.envs * (cut.envs * cut.height * cut.width) + spot.q
                )
            elif not done and (changed or not equal(a, b) or (wp.static(relit) and triangle_of(ends.after) != MISS)):
                last, rise, whole = through(
                    view, cut, keys, stage, instances, marks, spot, 0, each, ends.before, ends.after, -1, room, most,
                    band, count,
                )  # fmt: skip
                if last < 0:
                    grown = log_of(b) - log_of(a)
            if one and not done and last < 0:
                if untold(cut, stage, change, spot, ends, rise, grown, whole):
                    rise = pixel(UNKNOWN)
                    last = note(
                        cut, instances, spot, each // 2, ends.before, ends.after, rise, last, room, most, band, count
                    )
            if one and not done and last >= 0:
                instances.tail[last] = rise
                instances.ends[last] = 1

    @wp.kernel(module="unique", enable_backward=False)
    def find_ends(
        # in
        view: CameraView,
        cut: Cut,
        workers: int,
        room: int,
        most: int,
        others0: int,
        band: int,
        others_count: wp.array(dtype=int),
        stage: Stage,
        start: wp.array3d(dtype=wp.uint64),
        # in or out
        several: Several,
        changes: Changes,
        instances: Instances,
        count: wp.array(dtype=int),
    ):
        """Lists both ends of each run of pixels that show several surfaces; arguments as of `find_plain`."""
        each = cut.slots + 1
        inner = cut.envs * cut.height * cut.width
        none = pixel(UNKNOWN)
        j = others0 + wp.tid()
        while j < others0 + others_count[band]:
            at = several.at[j]
            spot = spot_of(view, cut, cut.first + at // inner, at % inner)
            last = wp.int32(-1)
            # The present run: the instant at which it began, and the z-buffer entry there.
            begun = wp.int32(0)
            seen = ends_of(cut, stage, start, spot).before
            for n in range(stage.probes[spot.env]):
                c = several.first[j * cut.probes + n]
                while c >= 0:
                    # One surface ends at `low`, the next begins at `high`.
                    low = changes.low[c]
                    high = low + 1
                    hit = changes.before[c]
                    then = changes.after[c]
                    later = changes.later[c]
                    changes.begun[c] = each
                    if low > begun:
                        changes.begun[c] = begun
                        changes.seen[c] = seen
                        changes.opened[c] = last
                        last = note(cut, instances, spot, low, hit, hit, none, last, room, most, band, count)
                        changes.closed[c] = last
                    if later > 0 and last >= 0:
                        instances.later[last] = later - SHARP
                    begun = high
                    seen = then
                    if high <= cut.slots:
                        last = note(cut, instances, spot, high, then, then, none, last, room, most, band, count)
                        if later > 0:
                            instances.later[last] = later + SHARP - PARTS
                    c = changes.following[c]
            several.begun[j] = begun
            several.seen[j] = seen
            several.opened[j] = last
            if begun > cut.slots and last >= 0:
                instances.ends[last] = 1
            j += workers

    @wp.kernel(module="unique", enable_backward=False, cuda_max_registers=FEW_REGISTERS)
    def find_runs(
        # in
        view: CameraView,
        cut: Cut,
        workers: int,
        room: int,
        most: int,
        others0: int,
        band: int,
        others_count: wp.array(dtype=int),
        changes0: int,
        most_changes: int,
        changes_count: wp.array(dtype=int),
        keys: Keyframes,
        stage: Stage,
        marks: Marks,
        change: Change,
        image: wp.array3d(dtype=pixel),
        start: wp.array3d(dtype=wp.uint64),
        frames: wp.array3d(dtype=pixel),
        several: Several,
        changes: Changes,
        # in or out
        instances: Instances,
        count: wp.array(dtype=int),
    ):
        """Lists the instants within each run of pixels that show several surfaces: of those that end in a change, of
        which there are changes_count[band], the first most_changes of them from changes0 on, then of those at the end
        of the interval. Arguments as of `find_plain`.

        It may be one surface after all, that comes so fast that two probes alone do not tell.
        """
        each = cut.slots + 1
        inner = cut.envs * cut.height * cut.width
        inside = wp.min(changes_count[band], most_changes)
        i = wp.tid()
        while i < inside + others_count[band]:
            c = changes0 + i
            j = others0 + i - inside
            if i < inside:
                j = changes.job[c]
            at = several.at[j]
            spot = spot_of(view, cut, cut.first + at // inner, at % inner)
            ends = ends_of(cut, stage, start, spot)
            begun = wp.int32(0)
            end = each
            seen = wp.uint64(0)
            hit = ends.after
            opened = wp.int32(0)
            if i < inside:
                begun = changes.begun[c]
                seen = changes.seen[c]
                opened = changes.opened[c]
                end = changes.low[c]
                hit = changes.before[c]
            else:
                begun = several.begun[j]
                seen = several.seen[j]
                opened = several.opened[j]
            if begun < end:
                last, rise, whole = through(
                    view, cut, keys, stage, instances, marks, spot, begun, end, seen, hit, opened, room, most, band,
                    count,
                )  # fmt: skip
                if i < inside:
                    closed = changes.closed[c]
                    instances.previous[closed] = last
                    instances.rise[closed] = rise
                else:
                    if last < 0:
                        x = spot.x - cut.margin
                        y = spot.y - cut.margin
                        a = image[spot.env, spot.y, spot.x]
                        if spot.k > 0:
                            a = frames[spot.env * cut.coarse + spot.k - 1, y, x]
                        b = frames[spot.env * cut.coarse + spot.k, y, x]
                        if untold(cut, stage, change, spot, ends, rise, log_of(b) - log_of(a), whole):
                            rise = pixel(UNKNOWN)
                            last = note(
                                cut, instances, spot, each // 2, ends.before, ends.after, rise, last, room, most, band,
                                count,
                            )  # fmt: skip
                    if last >= 0:
                        instances.tail[last] = rise
                        instances.ends[last] = 1
            i += workers

    return find_plain, find_ends, find_runs
