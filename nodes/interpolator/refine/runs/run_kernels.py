"""Lists the samples of pixels that show several surfaces: at both ends of each run of one, and where ln I bends in it.

`request_run_ends` lists those at the changes from one surface to another, and then `request_runs` those of each run by
itself: some pixels have many runs, and a GPU waits for the slowest of its threads.
"""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.image_kernels import pixel_type
from nodes.interpolator.refine.light.flicker_kernels import Marks
from nodes.interpolator.refine.paths.run_path_kernels import make_needs_midpoint, make_request_run
from nodes.interpolator.refine.runs.transition_kernels import ChangingPixels, Transitions
from nodes.interpolator.refine.samples.list_kernels import ListPart, end_of
from nodes.interpolator.refine.samples.request_kernels import (
    FRAME_AFTER,
    FRAME_BEFORE,
    LIMB,
    PARTS,
    REPEATED,
    SHARP,
    UNKNOWN,
    make_request,
    make_requests,
)
from nodes.interpolator.refine.window_kernels import (
    FEW_REGISTERS,
    PixelInterval,
    Run,
    WindowParameters,
    WindowScene,
    end_entries_of,
    frame_after,
    frame_before,
    make_coarse_frames,
    pixel_interval_of,
)
from nodes.interpolator.relight.change_kernels import Change
from nodes.interpolator.relight.features import LightChanges
from nodes.interpolator.rigid.keyframe_kernels import log_of
from nodes.interpolator.rigid.look_up.look_up_kernels import make_keyframes
from nodes.renderer.raster.depth_kernels import BACK, NO_ENTRY, back_of, entry_of
from nodes.renderer.raster.lens.view_kernels import CameraView

wp.set_module_options({"enable_backward": False})


@cache
def make_request_limb(channels: int) -> Any:
    """Makes the function `request_limb`; channels: 1 (luminance) or 3 (RGB)."""
    pixel = pixel_type(channels)
    Requests: Any = make_requests(channels)
    request = make_request(channels)

    @wp.func
    def request_limb(
        params: WindowParameters,
        requests: Requests,
        px: PixelInterval,
        low: int,
        later: int,
        triangle: int,
        seen: wp.uint64,
        weights: wp.vec3,
        previous: int,
        out: ListPart,
    ):
        """Lists a point of an outline, as `request` does, by the places of things at the instant that is nearest within
        the coarse interval.

        low: the instant after which the sample is, by `later` PARTS. seen: z-buffer entry of the same side of the
        surface.
        """
        i = wp.clamp(low + wp.where(2 * later >= PARTS, 1, 0), 1, params.slots)
        last = request(params, requests, px, i, NO_ENTRY, NO_ENTRY, pixel(UNKNOWN), previous, out)
        requests.after[last] = entry_of(1.0, triangle | wp.where(back_of(seen) == 1, BACK, 0))
        requests.weights[last] = weights
        requests.later[last] = later + (low - i) * PARTS
        requests.shown[last] = LIMB
        return last

    return request_limb


@cache
def make_request_run_ends(channels: int, steady: bool, limbs: bool) -> wp.Kernel:
    """Makes the kernel `request_run_ends`; channels: 1 (luminance) or 3 (RGB). steady: no light flickers, so that what
    a frame shows is shown shortly before and after it too. limbs: whether light may be another one at the outline of
    something."""
    pixel = pixel_type(channels)
    Requests: Any = make_requests(channels)
    request = make_request(channels)
    request_limb = make_request_limb(channels) if limbs else None

    @wp.kernel(module="unique", enable_backward=False)
    def request_run_ends(
        # in
        view: CameraView,
        params: WindowParameters,
        workers: int,
        scene: WindowScene,
        # in or out
        changing: ChangingPixels,
        changing_part: ListPart,
        transitions: Transitions,
        requests: Requests,
        out: ListPart,
    ):
        """Lists both ends of each run of pixels that show several surfaces; arguments as of
        `request_single_surface`."""
        each = params.slots + 1
        none = pixel(UNKNOWN)
        j = changing_part.start + wp.tid()
        while j < end_of(changing_part):
            px = pixel_interval_of(view, params, changing.at[j])
            last = wp.int32(-1)
            # The present run: the instant at which it began, and the z-buffer entry there.
            begun = wp.int32(0)
            seen = end_entries_of(params, scene, px).before
            for n in range(scene.probes[px.env]):
                c = changing.first[j * params.probes + n]
                while c >= 0:
                    # One surface ends at `low`, the next begins at `high`.
                    low = transitions.low[c]
                    high = low + 1
                    hit = transitions.before[c]
                    then = transitions.after[c]
                    later = transitions.later[c]
                    limb = wp.int32(-1)
                    if wp.static(limbs):
                        limb = transitions.limb[c]
                    transitions.begun[c] = each
                    if low > begun:
                        transitions.begun[c] = begun
                        transitions.seen[c] = seen
                        transitions.opened[c] = last
                        last = request(params, requests, px, low, hit, hit, none, last, out)
                        transitions.closed[c] = last
                    if limb >= 0:
                        if wp.static(limbs):
                            weights = transitions.weights[c]
                            last = request_limb(
                                params, requests, px, low, wp.max(later - SHARP, 1), limb, hit, weights, last, out
                            )
                    elif low > begun:
                        requests.later[last] = later - SHARP
                    elif last >= 0:
                        # Of one instant alone: its light is there from where the surface comes until it goes.
                        last = request(params, requests, px, low, NO_ENTRY, NO_ENTRY, none, last, out)
                        requests.later[last] = wp.max(later - SHARP, 1)
                        requests.shown[last] = REPEATED
                    if wp.static(steady) and limb < 0 and low == 0 and begun == 0:
                        # Of a frame there is no instant: its value is that until the change, below from then on.
                        # Two of a pixel at one instant must not be evaluated: what shades the first one forgets what
                        # hides its lamps.
                        last = request(params, requests, px, high, NO_ENTRY, NO_ENTRY, none, last, out)
                        requests.later[last] = wp.max(later - SHARP, 1) - PARTS
                        requests.shown[last] = FRAME_BEFORE
                    begun = high
                    seen = then
                    if limb < -1:
                        if wp.static(limbs):
                            weights = transitions.weights[c]
                            last = request_limb(
                                params,
                                requests,
                                px,
                                low,
                                wp.min(later + SHARP, PARTS - 1),
                                -2 - limb,
                                then,
                                weights,
                                last,
                                out,
                            )
                    if high <= params.slots:
                        last = request(params, requests, px, high, then, then, none, last, out)
                        if limb >= -1:
                            requests.later[last] = later + SHARP - PARTS
                    elif wp.static(steady) and limb >= -1:
                        last = request(params, requests, px, low, NO_ENTRY, NO_ENTRY, none, last, out)
                        requests.later[last] = wp.min(later + SHARP, PARTS - 1)
                        requests.shown[last] = FRAME_AFTER
                    c = transitions.following[c]
            changing.begun[j] = begun
            changing.seen[j] = seen
            changing.opened[j] = last
            if begun > params.slots and last >= 0:
                requests.ends[last] = 1
            j += workers

    return request_run_ends


@cache
def make_request_runs(
    lens: str, channels: int, waveform_count: int, relit: bool, painted: bool, textured: bool, changes: LightChanges
) -> wp.Kernel:
    """Makes the kernel `request_runs`; arguments as of make_request_single_surface."""
    pixel = pixel_type(channels)
    Keyframes: Any = make_keyframes(channels, waveform_count)
    Requests: Any = make_requests(channels)
    CoarseFrames: Any = make_coarse_frames(channels)
    request = make_request(channels)
    request_run = make_request_run(lens, channels, waveform_count, relit, painted, textured, changes)
    needs_midpoint = make_needs_midpoint(channels, changes)

    @wp.kernel(module="unique", enable_backward=False, cuda_max_registers=FEW_REGISTERS)
    def request_runs(
        # in
        view: CameraView,
        params: WindowParameters,
        workers: int,
        keys: Keyframes,
        scene: WindowScene,
        coarse: CoarseFrames,
        marks: Marks,
        change: Change,
        changing: ChangingPixels,
        changing_part: ListPart,
        transitions: Transitions,
        transitions_part: ListPart,
        # in or out
        requests: Requests,
        out: ListPart,
    ):
        """Lists the instants within each run of pixels that show several surfaces: of those that end in a transition,
        then of those at the end of the interval. Arguments as of `request_single_surface`.

        It may be one surface after all, that comes so fast that two probes alone do not tell.
        """
        each = params.slots + 1
        inside = end_of(transitions_part) - transitions_part.start
        i = wp.tid()
        while i < inside + end_of(changing_part) - changing_part.start:
            c = transitions_part.start + i
            j = changing_part.start + i - inside
            if i < inside:
                j = transitions.job[c]
            px = pixel_interval_of(view, params, changing.at[j])
            ends = end_entries_of(params, scene, px)
            run = Run()
            run.end = each
            run.after = ends.after
            if i < inside:
                run.start = transitions.begun[c]
                run.before = transitions.seen[c]
                run.last = transitions.opened[c]
                run.end = transitions.low[c]
                run.after = transitions.before[c]
            else:
                run.start = changing.begun[j]
                run.before = changing.seen[j]
                run.last = changing.opened[j]
            if run.start < run.end:
                last, rise, whole, _exact = request_run(view, params, keys, scene, requests, marks, px, run, out)
                if i < inside:
                    closed = transitions.closed[c]
                    requests.previous[closed] = last
                    requests.rise[closed] = rise
                else:
                    if last < 0:
                        x = px.x - params.margin
                        y = px.y - params.margin
                        a = frame_before(params, coarse, px.env, px.k, y, x)
                        b = frame_after(params, coarse, px.env, px.k, y, x)
                        if needs_midpoint(params, scene, change, px, ends, rise, log_of(b) - log_of(a), whole):
                            rise = pixel(UNKNOWN)
                            last = request(params, requests, px, each // 2, ends.before, ends.after, rise, last, out)
                    if last >= 0:
                        requests.tail[last] = rise
                        requests.ends[last] = 1
            i += workers

    return request_runs
