"""Lists the samples of pixels that show one surface all along, and the pixels that show several."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.image_kernels import pixel_type
from nodes.interpolator.refine.light.flicker_kernels import Marks, make_request_marks
from nodes.interpolator.refine.paths.motion_kernels import moves
from nodes.interpolator.refine.paths.run_path_kernels import (
    make_light_flags,
    make_light_is_even,
    make_needs_midpoint,
    make_request_run,
)
from nodes.interpolator.refine.runs.silhouette_kernels import is_beside_silhouette
from nodes.interpolator.refine.runs.transition_kernels import ChangingPixels
from nodes.interpolator.refine.samples.list_kernels import ListPart, take_entry
from nodes.interpolator.refine.samples.request_kernels import PREDICTED, UNKNOWN, make_request, make_requests
from nodes.interpolator.refine.window_kernels import (
    FEW_REGISTERS,
    Run,
    WindowParameters,
    WindowScene,
    end_entries_of,
    frame_after,
    frame_before,
    instant_of,
    make_coarse_frames,
    pixel_interval_at,
    shows_one,
)
from nodes.interpolator.relight.change_kernels import Change
from nodes.interpolator.relight.features import LightChanges
from nodes.interpolator.rigid.keyframe_kernels import equal, log_of
from nodes.interpolator.rigid.look_up.log_kernels import apart
from nodes.interpolator.rigid.look_up.look_up_kernels import make_keyframes
from nodes.renderer.raster.depth_kernels import MISS, NO_ENTRY, triangle_of
from nodes.renderer.raster.lens.view_kernels import CameraView

wp.set_module_options({"enable_backward": False})

BESIDE = wp.constant(2.5)
"""Change of ln I over a coarse interval, of `straight`, by which light alone may differ from what textures tell."""


@cache
def make_predict(channels: int) -> Any:
    """Makes the function `predict`; channels: 1 (luminance) or 3 (RGB)."""
    pixel = pixel_type(channels)
    Requests: Any = make_requests(channels)

    @wp.func
    def predict(params: WindowParameters, requests: Requests, last: int, tail: pixel, before: pixel, after: pixel):
        """Gives the requests of a coarse interval the values that they have by the changes of ln I between them, as far
        as these lead from the frame before to the frame after; tells whether they do.

        last: of the requests. tail: change of ln I from there to the frame after. before, after: ln I of the frames.
        """
        change = tail
        j = last
        while j >= 0:
            change += requests.rise[j]
            # Where the list has had no room another pixel's entry stands there, which must end too.
            j = wp.min(requests.previous[j], j - 1)
        # What light does besides is even over the interval.
        beside = after - before - change
        if apart(beside, pixel(0.0)) > BESIDE * params.straight:
            return False
        each = float(params.slots + 1)
        value = after - tail
        j = last
        while j >= 0:
            rise = requests.rise[j]
            i = float(instant_of(params, requests.at[j]))
            requests.rise[j] = value - (1.0 - i / each) * beside
            requests.before[j] = NO_ENTRY
            requests.after[j] = NO_ENTRY
            requests.shown[j] = PREDICTED
            value -= rise
            j = wp.min(requests.previous[j], j - 1)
        return True

    return predict


@cache
def make_request_single_surface(
    lens: str, channels: int, waveform_count: int, relit: bool, painted: bool, textured: bool, changes: LightChanges
) -> wp.Kernel:
    """Makes the kernel `request_single_surface`; arguments as of make_look_up.

    relit: whether lights flicker with so many waveforms that surfaces are shaded anew. painted: whether anything has a
    texture or colours at vertices. textured: whether textures are followed by themselves, as of
    follows_textures. changes: of light in the scene.
    """
    pixel = pixel_type(channels)
    Keyframes: Any = make_keyframes(channels, waveform_count)
    Requests: Any = make_requests(channels)
    CoarseFrames: Any = make_coarse_frames(channels)
    request = make_request(channels)
    request_marks = make_request_marks(channels, waveform_count) if waveform_count else None
    request_run = make_request_run(lens, channels, waveform_count, relit, painted, textured, changes)
    light_is_even = make_light_is_even(changes)
    predict = make_predict(channels) if textured else None
    needs_midpoint, light_flags = make_needs_midpoint(channels, changes), make_light_flags(changes)

    @wp.kernel(module="unique", enable_backward=False, cuda_max_registers=FEW_REGISTERS)
    def request_single_surface(
        # in
        view: CameraView,
        params: WindowParameters,
        row0: int,
        span: int,
        keys: Keyframes,
        scene: WindowScene,
        coarse: CoarseFrames,
        marks: Marks,
        change: Change,
        # out
        requests: Requests,
        out: ListPart,
        changing: ChangingPixels,
        changing_part: ListPart,
    ):
        """Lists the instants at which pixels are to be looked at that show one surface at both ends of a coarse
        interval and at all probes, in a part of the list; what shows several is listed in `changing`, in a part of
        that.

        row0: first row of the band. span: pixels of a thread. marks: of lights that flicker.
        """
        n, row, part = wp.tid()
        env = n % params.envs
        k = params.first + n // params.envs
        if scene.held[env] == 1:
            return
        y = row0 + row
        each = params.slots + 1
        for x in range(part * span, wp.min(part * span + span, params.width)):
            px = pixel_interval_at(view, params, env, k, y, x)
            ends = end_entries_of(params, scene, px)
            one = shows_one(params, scene, px, ends.before, ends.after)
            grazing = is_beside_silhouette(view, params, scene, px, ends.before)
            if grazing:
                one = False
            changed = wp.bool(ends.before != ends.after)
            if one and not changed:
                # It may have come back, or be as far on as what is painted on it repeats.
                changed = moves(params, scene, px, ends.before)
            a = frame_before(params, coarse, env, k, y, x)
            b = frame_after(params, coarse, env, k, y, x)
            if wp.static(changes.changes_lamps):
                if one and not changed and params.parts > 0:
                    changed = scene.light_changes[n, y, x] != wp.uint64(0)
            done = wp.bool(False)
            whole = wp.bool(True)
            predicted = wp.bool(False)
            last = wp.int32(-1)
            rise = pixel(UNKNOWN)
            grown = pixel(0.0)
            if wp.static(waveform_count > 0):
                # Where other light changes, keyframe B does not tell how much of it flickers within the gap.
                if one and not changed:
                    changed = light_flags(params, scene, change, px, each // 2, ends.before) != 0
                if one and not changed:
                    done = True
                    at_b = (env * view.height + px.y) * view.width + px.x
                    last, rise = request_marks(
                        params,
                        keys,
                        requests,
                        marks,
                        px,
                        at_b,
                        ends.after,
                        log_of(a),
                        log_of(b),
                        out,
                    )
                    grown = log_of(b) - log_of(a)
            if not one:
                listed = changing_part.start + take_entry(changing_part)
                changing.at[listed] = n // params.envs * (params.envs * params.height * params.width) + px.q
                changing.grazing[listed] = wp.where(grazing, 1, 0)
            elif not done and (changed or not equal(a, b) or (wp.static(relit) and triangle_of(ends.after) != MISS)):
                run = Run()
                run.end = each
                run.before = ends.before
                run.after = ends.after
                run.last = -1
                last, rise, whole, exact = request_run(view, params, keys, scene, requests, marks, px, run, out)
                if wp.static(textured):
                    if exact and last >= 0 and light_is_even(params, scene, change, px, each // 2, ends.before):
                        predicted = predict(params, requests, last, rise, log_of(a), log_of(b))
                if last < 0:
                    grown = log_of(b) - log_of(a)
            if one and last < 0:
                if needs_midpoint(params, scene, change, px, ends, rise, grown, whole):
                    rise = pixel(UNKNOWN)
                    last = request(params, requests, px, each // 2, ends.before, ends.after, rise, last, out)
            if one and last >= 0 and not predicted:
                requests.tail[last] = rise
                requests.ends[last] = 1

    return request_single_surface
