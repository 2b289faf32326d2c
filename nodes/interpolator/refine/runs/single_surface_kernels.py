"""Lists the samples of pixels that show one surface all along, and the pixels that show several."""

from functools import cache
from typing import Any

import warp as wp

from evis.gpu.append_kernels import take_place
from nodes.interpolator.refine.light.flicker_kernels import Marks, make_note_marks
from nodes.interpolator.refine.paths.motion_kernels import moves
from nodes.interpolator.refine.paths.run_path_kernels import make_relit_between, make_through, make_untold
from nodes.interpolator.refine.runs.silhouette_kernels import beside_outline
from nodes.interpolator.refine.runs.transition_kernels import Several
from nodes.interpolator.refine.samples.request_kernels import UNKNOWN, make_instances, make_note
from nodes.interpolator.refine.window_kernels import (
    FEW_REGISTERS,
    Cut,
    Stage,
    ends_of,
    frame_after,
    frame_before,
    shows_one,
    spot_at,
)
from nodes.interpolator.relight.change_kernels import Change
from nodes.interpolator.relight.features import LightChanges
from nodes.interpolator.rigid.keyframe_kernels import equal, log_of
from nodes.interpolator.rigid.look_up.look_up_kernels import make_keyframes
from nodes.renderer.raster.depth_kernels import MISS, triangle_of
from nodes.renderer.raster.lens.view_kernels import CameraView

wp.set_module_options({"enable_backward": False})


@cache
def make_find_plain(
    lens: str, channels: int, ways: int, relit: bool, painted: bool, changes: LightChanges
) -> wp.Kernel:
    """Makes the kernel `find_plain`; arguments as of make_look_up.

    relit: whether lights flicker in so many ways that surfaces are shaded anew. painted: whether anything has a
    texture or colours at vertices. changes: of light in the scene.
    """
    pixel: Any = wp.float32 if channels == 1 else wp.vec3
    Keyframes: Any = make_keyframes(channels, ways)
    Instances: Any = make_instances(channels)
    note, note_marks = make_note(channels), make_note_marks(channels, ways) if ways else None
    through = make_through(lens, channels, ways, relit, painted, changes)
    untold, relit_between = make_untold(channels, changes), make_relit_between(changes)

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

        marks: of lights that flicker; strength [rows ways], within [slots E ways]: how strong they are at coarse frames
        and within. image, start: keyframe A and its z-buffer, with the margin. frames: [E K, h, w].
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
            grazing = beside_outline(view, cut, stage, start, spot, ends.before)
            if grazing:
                one = False
            changed = wp.bool(ends.before != ends.after)
            if one and not changed:
                # It may have come back, or be as far on as what is painted on it repeats.
                changed = moves(cut, stage, spot, ends.before)
            a = frame_before(cut, image, frames, env, k, y, x)
            b = frame_after(cut, frames, env, k, y, x)
            if wp.static(changes.changes_lamps):
                if one and not changed and cut.parts > 0:
                    changed = stage.passing[n, y, x] != wp.uint64(0)
            done = wp.bool(False)
            whole = wp.bool(True)
            last = wp.int32(-1)
            rise = pixel(UNKNOWN)
            grown = pixel(0.0)
            if wp.static(ways > 0):
                if one and not changed:
                    done = True
                    at_b = (env * view.height + spot.y) * view.width + spot.x
                    calm = not relit_between(cut, stage, change, spot, each // 2, ends.before)
                    last, rise = note_marks(
                        cut, keys, instances, marks, spot, at_b, ends.after, calm, log_of(a), log_of(b), strength,
                        within, room, most, band, count,
                    )  # fmt: skip
                    grown = log_of(b) - log_of(a)
            if not one:
                listed = others0 + take_place(others_count, band)
                several.at[listed] = n // cut.envs * (cut.envs * cut.height * cut.width) + spot.q
                several.grazing[listed] = wp.where(grazing, 1, 0)
            elif not done and (changed or not equal(a, b) or (wp.static(relit) and triangle_of(ends.after) != MISS)):
                last, rise, whole = through(
                    view, cut, keys, stage, instances, marks, spot, 0, each, ends.before, ends.after, -1, room, most,
                    band, count,
                )  # fmt: skip
                if last < 0:
                    grown = log_of(b) - log_of(a)
            if one and last < 0:
                if untold(cut, stage, change, spot, ends, rise, grown, whole):
                    rise = pixel(UNKNOWN)
                    last = note(
                        cut, instances, spot, each // 2, ends.before, ends.after, rise, last, room, most, band, count
                    )
            if one and last >= 0:
                instances.tail[last] = rise
                instances.ends[last] = 1

    return find_plain
