"""Lists samples along one run of a surface: from one mark to the next; and tells whether frames determine all between
them."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.displacement_kernels import shift_at
from nodes.interpolator.image_kernels import pixel_type
from nodes.interpolator.refine.light.flicker_kernels import Marks, entry_near, marks_of
from nodes.interpolator.refine.light.light_visibility_kernels import part_at
from nodes.interpolator.refine.paths.albedo_path_kernels import finer_than_pixels, make_request_albedo_path
from nodes.interpolator.refine.paths.keyframe_path_kernels import make_request_keyframe_path
from nodes.interpolator.refine.paths.texture_path_kernels import make_request_texture_path, stays_on_chart
from nodes.interpolator.refine.samples.list_kernels import ListPart
from nodes.interpolator.refine.samples.request_kernels import UNKNOWN, make_request, make_requests
from nodes.interpolator.refine.window_kernels import (
    EndEntries,
    PixelInterval,
    Run,
    WindowParameters,
    WindowScene,
    instant_of,
    parts_of,
    slot_row,
)
from nodes.interpolator.relight.change_kernels import (
    LIT_ANEW,
    SHADED,
    VIEWED,
    Change,
    in_the_open,
    point_of,
)
from nodes.interpolator.relight.features import LightChanges
from nodes.interpolator.relight.flag_kernels import make_point_flags
from nodes.interpolator.rigid.look_up.log_kernels import apart
from nodes.interpolator.rigid.look_up.look_up_kernels import make_keyframes
from nodes.renderer.raster.depth_kernels import MISS, depth_of, triangle_of
from nodes.renderer.raster.lens.view_kernels import CameraView

wp.set_module_options({"enable_backward": False})


@cache
def make_request_run(
    lens: str, channels: int, waveform_count: int, relit: bool, painted: bool, textured: bool, changes: LightChanges
) -> Any:
    """Makes the function `request_run`, which lists the samples of a run; arguments as of
    make_request_single_surface."""
    pixel = pixel_type(channels)
    Keyframes: Any = make_keyframes(channels, waveform_count)
    Requests: Any = make_requests(channels)
    request_keyframe_path, request = make_request_keyframe_path(lens, channels, waveform_count), make_request(channels)
    request_texture_path = make_request_texture_path(lens, channels, waveform_count) if textured else None
    request_albedo_path = make_request_albedo_path(channels, waveform_count) if painted else None

    @wp.func
    def request_span(
        view: CameraView,
        params: WindowParameters,
        keys: Keyframes,
        scene: WindowScene,
        requests: Requests,
        px: PixelInterval,
        run: Run,
        out: ListPart,
    ):
        """Lists instants as `request_keyframe_path` does, in the nearer keyframe, or in the other one where that does
        not show the way, and by what is painted on the surface where none does. What is painted more finely than
        their pixels is followed by its texture.

        Tells besides whether ln I goes as told but for what light does."""
        nearer = wp.where(2 * px.k >= params.coarse and px.k > 0, 1, 0)
        new = run.last
        rise = pixel(UNKNOWN)
        whole = wp.bool(False)
        tries = wp.int32(0)
        followed = wp.bool(False)
        if wp.static(request_albedo_path is not None):
            if finer_than_pixels(view, scene, px, run.before):
                if wp.static(request_texture_path is not None):
                    followed = stays_on_chart(params, scene, px, run)
                if not followed:
                    tries = wp.int32(2)
        while tries < 2 and not whole and new == run.last and (tries == 0 or px.k + run.start > 0):
            which = wp.where(tries == 0, nearer, 1 - nearer)
            if wp.static(request_texture_path is not None):
                if followed:
                    new, rise, whole = request_texture_path(view, params, keys, scene, requests, px, which, run, out)
            if not followed:
                new, rise, whole = request_keyframe_path(view, params, keys, scene, requests, px, which, run, out)
            tries += 1
        if wp.static(request_albedo_path is not None):
            if not whole and triangle_of(run.before) != MISS:
                rest = run
                if new != run.last:
                    rest.start = instant_of(params, requests.at[new])
                    rest.before = entry_near(params, scene, px, rest.start, run.start, run.before)
                    rest.last = new
                new, rise = request_albedo_path(view, params, keys, scene, requests, px, rest, out)
        return new, rise, whole, whole and followed

    @wp.func
    def request_run(
        view: CameraView,
        params: WindowParameters,
        keys: Keyframes,
        scene: WindowScene,
        requests: Requests,
        marks: Marks,
        px: PixelInterval,
        run: Run,
        out: ListPart,
    ):
        """Lists instants as `request_span` does, from one mark to the next where lights flicker, and from one shadow's
        edge to the next."""
        marked = wp.int32(0)
        first = wp.int32(0)
        if wp.static(waveform_count > 0 or relit):
            first, past = marks_of(marks, px)
            marked = past - first
        edges = wp.int32(0)
        parts = wp.int32(1)
        bits = wp.uint64(0)
        if wp.static(changes.changes_lamps):
            if params.parts > 0:
                bits = scene.light_changes[
                    (px.k - params.first) * params.envs + px.env, px.y - params.margin, px.x - params.margin
                ]
                if bits != wp.uint64(0):
                    parts = parts_of(scene, px.env)
                    edges = 2 * parts
        span = Run()
        span.start = run.start
        span.before = run.before
        span.last = run.last
        rise = pixel(UNKNOWN)
        whole = wp.bool(False)
        exact = wp.bool(False)
        # All by the same code: a GPU's cache of instructions would not hold copies of it.
        for n in range(marked + edges + 1):
            i = run.end
            later = wp.int32(0)
            inside = wp.bool(False)
            if n < marked:
                i = marks.at[first + n]
                later = marks.later[first + n]
                inside = i > run.start and i < run.end
            elif n < marked + edges:
                # Lamps are hidden or seen again between the two ends of a part.
                m = n - marked
                i = part_at(params, parts, (m + 1) // 2)
                inside = ((bits >> wp.uint64(m // 2)) & wp.uint64(1)) != wp.uint64(0) and i > span.start and i < run.end
            if inside or n == marked + edges:
                span.end = i
                span.after = run.after
                if inside:
                    span.after = entry_near(params, scene, px, i, span.start, span.before)
                last, rise, whole, exact = request_span(view, params, keys, scene, requests, px, span, out)
                if inside:
                    last = request(params, requests, px, i, span.after, span.after, rise, last, out)
                    requests.later[last] = later
                    span.start = i
                    span.before = span.after
                span.last = last
        return span.last, rise, whole, exact and edges + marked == 0

    return request_run


@cache
def make_light_flags(changes: LightChanges) -> Any:
    """Makes the function `light_flags`; changes: of light in the scene."""
    point_flags = make_point_flags(changes) if changes.any else None

    @wp.func
    def light_flags(
        params: WindowParameters, scene: WindowScene, change: Change, px: PixelInterval, i: int, hit: wp.uint64
    ):
        """Gives what may change in the gap of the light on what a pixel shows at instant i, as `point_flags` does,
        beside lamps that flicker; 0 where it shows nothing."""
        if wp.static(point_flags is not None):
            t = triangle_of(hit)
            if t != MISS:
                body = scene.targets.pieces[t][0]
                row = slot_row(params, px.env, px.k, i)
                at = row * scene.motions.shape[1] + body
                to_a = shift_at(scene.motions, at)
                to_b = shift_at(scene.motions, at + scene.motions.shape[0] // 2 * scene.motions.shape[1])
                return point_flags(change, body, px.env, row, hit, depth_of(hit) * px.d, to_a, to_b)
        return 0

    return light_flags


@cache
def make_light_is_even(changes: LightChanges) -> Any:
    """Makes the function `light_is_even`; changes: of light in the scene."""
    light_flags = make_light_flags(changes)

    @wp.func
    def light_is_even(
        params: WindowParameters, scene: WindowScene, change: Change, px: PixelInterval, i: int, hit: wp.uint64
    ):
        """Tells whether light on what a pixel shows at instant i goes evenly in the gap: nothing can come before a
        lamp, and what moves against it is in no beam and not glossy."""
        flag = light_flags(params, scene, change, px, i, hit)
        if flag == 0:
            return True
        if wp.static(changes.spot):
            return False
        if (flag & (LIT_ANEW | SHADED)) != 0:
            return False
        if wp.static(changes.view):
            if (flag & VIEWED) != 0 and change.alpha[change.instance[triangle_of(hit)]] >= 0.0:
                return False
        if wp.static(changes.shadows):
            row = slot_row(params, px.env, px.k, i)
            return in_the_open(flag, point_of(change, change.casters, row, hit, depth_of(hit) * px.d))
        return True

    return light_is_even


@cache
def make_needs_midpoint(channels: int, changes: LightChanges) -> Any:
    """Makes the function `needs_midpoint`, which tells of light that frames do not show; arguments as of
    make_request_single_surface."""
    # What light does otherwise goes on evenly, as far as frames tell.
    passing = changes.passes or changes.view
    light_flags = make_light_flags(changes)
    pixel = pixel_type(channels)

    @wp.func
    def needs_midpoint(
        params: WindowParameters,
        scene: WindowScene,
        change: Change,
        px: PixelInterval,
        ends: EndEntries,
        rise: pixel,
        grown: pixel,
        whole: bool,
    ):
        """Tells whether a pixel that shows one surface and has no sample has to be looked at halfway.

        So it is where ln I has grown otherwise than it rises in the keyframes, or light may have come and gone. whole:
        they show all of it.
        """
        if apart(grown, pixel(0.0)) > params.jump and (not whole or apart(rise, grown) > params.bend):
            return True
        if wp.static(passing):
            # A shadow, a highlight or a lamp may have come and gone: frames alone do not tell.
            return light_flags(params, scene, change, px, (params.slots + 1) // 2, ends.before) != 0
        return False

    return needs_midpoint
