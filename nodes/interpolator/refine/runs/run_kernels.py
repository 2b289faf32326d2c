"""Lists the samples of pixels that show several surfaces: at both ends of each run of one, and where ln I bends in it.

`find_ends` lists those at the changes from one surface to another, and then `find_runs` those of each run by itself:
some pixels have many runs, and a GPU waits for the slowest of its threads.
"""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.refine.light.flicker_kernels import Marks
from nodes.interpolator.refine.paths.run_path_kernels import make_through, make_untold
from nodes.interpolator.refine.runs.transition_kernels import Changes, Several
from nodes.interpolator.refine.samples.request_kernels import (
    FRAME_AFTER,
    FRAME_BEFORE,
    PARTS,
    SHARP,
    UNKNOWN,
    make_instances,
    make_note,
)
from nodes.interpolator.refine.window_kernels import (
    FEW_REGISTERS,
    Cut,
    Stage,
    ends_of,
    frame_after,
    frame_before,
    spot_of,
)
from nodes.interpolator.relight.change_kernels import Change
from nodes.interpolator.relight.features import LightChanges
from nodes.interpolator.rigid.keyframe_kernels import log_of
from nodes.interpolator.rigid.look_up.look_up_kernels import make_keyframes
from nodes.renderer.raster.depth_kernels import NO_ENTRY
from nodes.renderer.raster.lens.view_kernels import CameraView

wp.set_module_options({"enable_backward": False})


@cache
def make_find_ends(channels: int, steady: bool) -> wp.Kernel:
    """Makes the kernel `find_ends`; channels: 1 (luminance) or 3 (RGB). steady: no light flickers, so that what a frame
    shows is shown shortly before and after it too."""
    pixel: Any = wp.float32 if channels == 1 else wp.vec3
    Instances: Any = make_instances(channels)
    note = make_note(channels)

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
                    if wp.static(steady) and later > 0 and low == 0 and begun == 0:
                        # Of a frame there is no instant: its value is that until the change, below from then on.
                        # Two of a pixel at one instant must not be evaluated: what shades the first one forgets what
                        # hides its lamps.
                        last = note(cut, instances, spot, high, NO_ENTRY, NO_ENTRY, none, last, room, most, band, count)
                        instances.later[last] = wp.max(later - SHARP, 1) - PARTS
                        instances.shown[last] = FRAME_BEFORE
                    begun = high
                    seen = then
                    if high <= cut.slots:
                        last = note(cut, instances, spot, high, then, then, none, last, room, most, band, count)
                        if later > 0:
                            instances.later[last] = later + SHARP - PARTS
                    elif wp.static(steady) and later > 0:
                        last = note(cut, instances, spot, low, NO_ENTRY, NO_ENTRY, none, last, room, most, band, count)
                        instances.later[last] = wp.min(later + SHARP, PARTS - 1)
                        instances.shown[last] = FRAME_AFTER
                    c = changes.following[c]
            several.begun[j] = begun
            several.seen[j] = seen
            several.opened[j] = last
            if begun > cut.slots and last >= 0:
                instances.ends[last] = 1
            j += workers

    return find_ends


@cache
def make_find_runs(lens: str, channels: int, ways: int, relit: bool, painted: bool, changes: LightChanges) -> wp.Kernel:
    """Makes the kernel `find_runs`; arguments as of make_find_plain."""
    pixel: Any = wp.float32 if channels == 1 else wp.vec3
    Keyframes: Any = make_keyframes(channels, ways)
    Instances: Any = make_instances(channels)
    note = make_note(channels)
    through = make_through(lens, channels, ways, relit, painted, changes)
    untold = make_untold(channels, changes)

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
                        a = frame_before(cut, image, frames, spot.env, spot.k, y, x)
                        b = frame_after(cut, frames, spot.env, spot.k, y, x)
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

    return find_runs
