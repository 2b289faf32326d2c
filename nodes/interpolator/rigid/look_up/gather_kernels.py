"""Makes the sub-frames: every pixel's surface point is looked up in both keyframes, and those that neither shows are
listed.

On a GPU three kernels do this, each of which lists what it leaves to the next ones: what most pixels need takes few
registers, so that many threads wait for memory at once. The first goes through all pixels, the second does those that
light may change on, and the last one looks with care at what is beside an edge. On a CPU the last one does all that is
listed.
"""

from functools import cache
from typing import Any, Literal

import warp as wp

from evis.gpu.append_kernels import take_place
from evis.gpu.reading_kernels import entry, whole_number
from nodes.interpolator.displacement_kernels import shift_at
from nodes.interpolator.image_kernels import pixel_type
from nodes.interpolator.relight.change_kernels import Change, Displacements, point_of
from nodes.interpolator.relight.features import LightChanges
from nodes.interpolator.relight.flag_kernels import make_point_flags
from nodes.interpolator.relight.relit_kernels import make_relit
from nodes.interpolator.rigid.look_up.both_keyframes_kernels import make_look_up_both, make_remodulate
from nodes.interpolator.rigid.look_up.log_kernels import apart, brighter, fused_luminance, make_radiance_of
from nodes.interpolator.rigid.look_up.look_up_kernels import DEMODULATED, HARD, SEEN, make_keyframes
from nodes.interpolator.rigid.look_up.portion_kernels import Place, Portion, place_in_turn, place_of, visible_point_of
from nodes.renderer.raster.depth_kernels import NO_ENTRY
from nodes.renderer.raster.lens.view_kernels import CameraView
from nodes.renderer.raster.surface_kernels import Surfaces, VisibilityBuffer

wp.set_module_options({"enable_backward": False})


@wp.struct
class GatherLists:
    """Holds what is listed while pixels are looked up; each count is of [bands].

    flagged: those that light may change on, and todo: those that are to be looked up with care, both as indices into
    [.., E, h, w] from slot0 on. pixels: those that no keyframe shows, as indices into [P E, H, W]; places: where single
    ones of these were listed. count: of `pixels`.
    """

    flagged: wp.array(dtype=int)
    flagged_count: wp.array(dtype=int)
    todo: wp.array(dtype=int)
    todo_count: wp.array(dtype=int)
    pixels: wp.array(dtype=int)
    places: wp.array(dtype=int)
    count: wp.array(dtype=int)


@cache
def make_light_differs(channels: int, waveform_count: int, changes: LightChanges) -> wp.Function:
    """Makes the function `light_differs`; changes: of light in the scene."""
    Keyframes: Any = make_keyframes(channels, waveform_count)
    relit = make_relit(changes)

    @wp.func
    def light_differs(
        change: Change,
        portion: Portion,
        keys: Keyframes,
        flag: int,
        n: int,
        env: int,
        hit: wp.uint64,
        at: int,
        behind: int,
        position: wp.vec3,
        seen_a: bool,
        seen_b: bool,
        share: float,
    ):
        """Tells whether light on the point that slot n of an environment shows changes otherwise than the keyframes
        tell, and otherwise how much above each of them ln of its radiance is; at, behind: of Displacements."""
        s = point_of(change, change.casters, n, hit, position)
        moves = Displacements()
        moves.motions = keys.motions
        moves.at = at
        moves.behind = behind
        row_a = portion.keyframes[0] + env
        row_b = portion.keyframes[1] + env
        return relit(change, flag, n, row_a, row_b, s, moves, seen_a, seen_b, share)

    return light_differs


@cache
def make_gather(
    lens: str,
    channels: int,
    waveform_count: int,
    look: Literal["first", "flagged", "careful"],
    changes: LightChanges,
    detailed: bool,
    kind: tuple[bool, bool, bool] | None,
    fast: bool,
    single: bool = False,
) -> wp.Kernel:
    """Makes the kernel that looks up the pixels of sub-frames in both keyframes.

    lens: `none` or a distortion model. channels: 1 (luminance) or 3 (RGB). waveform_count: as of `log_type`. look:
    `first` goes through all pixels and lists those that light may change on; `flagged` does these; both list what needs
    care, and `careful` does whatever is listed. changes: of light in the scene. detailed: as of make_look_up. kind:
    whether the scene has textures, shading normals of its own and colours at vertices, if textures are looked up at
    their own time. fast: as of the renderer's Features. single: pixels are listed one by one: what they see and their
    radiance stand where they do in the list, not in images.
    """
    listed, careful = look != "first", look == "careful"
    point_flags = make_point_flags(changes) if changes.any else None
    light_differs = make_light_differs(channels, waveform_count, changes) if listed and changes.any else None
    Keyframes: Any = make_keyframes(channels, waveform_count)
    pixel = pixel_type(channels)
    look_up_both = make_look_up_both(lens, channels, waveform_count, careful, detailed, kind is not None)
    remodulate = make_remodulate(channels, waveform_count, kind) if kind and careful else None
    radiance_of = make_radiance_of(channels, waveform_count)
    # Fewer than it would take, but of RGB: while some threads wait for memory there must be others.
    registers = (64 if look == "first" else 128) if channels == 1 and waveform_count == 0 else None

    @wp.kernel(module="unique", enable_backward=False, cuda_max_registers=registers, module_options={"fast_math": fast})
    def gather(
        # in
        view: CameraView,
        first: int,
        last: int,
        workers: int,
        band: int,
        portion: Portion,
        keys: Keyframes,
        change: Change,
        shown: VisibilityBuffer,
        surfaces: Surfaces,
        # in or out
        lists: GatherLists,
        # out
        frames: wp.array3d(dtype=pixel),
    ):
        """Computes the frames [E frames, h, w] of a portion.

        First: a thread does one pixel; those that light may change on go to `flagged`. Flagged: `workers` threads share
        flagged_count[band] of these. Both leave to `todo` what needs care. Careful: on a CPU entries first..last - 1 of
        that, on a GPU (last < 0) todo_count[band], shared likewise. What no keyframe shows goes to `pixels` from
        `first` on. So does that of which the keyframes differ by more than the tolerance in log radiance. Single
        pixels: entries first..last - 1 of `todo`, todo_count[band] at most; portion.packed and frames are [1, 1, list];
        z-buffers of what is listed in `pixels` are written to those that are shown; of NO_ENTRY nothing is looked up,
        and it is black.
        """
        m = view.margin
        j = first + wp.tid()
        end = j + 1
        if wp.static(single):
            end = wp.min(last, first + lists.todo_count[band])
        elif wp.static(careful):
            end = wp.where(last >= 0, last, lists.todo_count[band])
        elif wp.static(listed):
            end = lists.flagged_count[band]
        p = Place()
        p.row = -1
        while j < end:
            anew = wp.bool(False)
            if wp.static(careful):
                at = lists.todo[j]
                if at < 0:
                    at = -1 - at
                    anew = True
                p = place_of(view, portion, at, p)
            elif wp.static(listed):
                p = place_of(view, portion, lists.flagged[j], p)
            else:
                p = place_in_turn(view, portion, j)
            env = p.env
            y = p.y
            x = p.x
            n = (portion.slot0 + p.slot) * portion.envs + env
            i = whole_number(portion.index, portion.slot0 + p.slot)
            place = (n * view.height + y) * view.width + x
            hit = wp.uint64(0)
            if wp.static(single):
                hit = entry(portion.packed, j)
                frame = wp.int32(0)
                row_out = wp.int32(0)
                column_out = j
            else:
                hit = entry(portion.packed, place)
                frame = env * portion.frames + whole_number(portion.frame, portion.slot0 + p.slot)
                row_out = y - m
                column_out = x - m
            changed = wp.bool(True)
            if wp.static(not listed):
                changed = hit != entry(portion.unchanged, (env * view.height + y) * view.width + x)
            if wp.static(single) and hit == NO_ENTRY:
                frames[frame, row_out, column_out] = pixel(0.0)
            elif anew:
                lists.pixels[first + take_place(lists.count, band)] = place
            elif changed:
                s, body = visible_point_of(view, hit, y, x, portion.pieces, keys.motions.shape[1] - 1)
                since = n * keys.motions.shape[1] + body
                behind = keys.motions.shape[0] / 2 * keys.motions.shape[1]
                flag = wp.int32(0)
                if wp.static(changes.any):
                    if s.sky == 0:
                        to_a = shift_at(keys.motions, since)
                        to_b = shift_at(keys.motions, since + behind)
                        flag = point_flags(change, body, env, n, hit, s.point, to_a, to_b)
                later = wp.bool(False)
                if wp.static(not listed):
                    later = flag != 0
                looks = look_up_both(view, portion, keys, s, env, i, since, behind, wp.where(later, 0, 2))
                if wp.static(remodulate is not None):
                    if looks.state_a == DEMODULATED or looks.state_b == DEMODULATED:
                        looks = remodulate(view, n, y, x, hit, shown, surfaces, looks)
                hard = wp.bool(False)
                if wp.static(not careful):
                    hard = looks.state_a == HARD or looks.state_b == HARD
                seen_a = looks.state_a == SEEN
                seen_b = looks.state_b == SEEN
                share = float(i) / float(portion.upsampling)
                told = (seen_a or seen_b) and (s.sky == 1 or portion.relight == 0)
                if wp.static(light_differs is not None):
                    if told and flag != 0 and not hard:
                        otherwise, above_a, above_b = light_differs(
                            change, portion, keys, flag, n, env, hit, since, behind, s.point, seen_a, seen_b, share
                        )
                        told = not otherwise
                        # Of several lights only some change.
                        if wp.static(changes.relative and waveform_count == 0):
                            looks.a = brighter(looks.a, above_a)
                            looks.b = brighter(looks.b, above_b)
                difference = wp.float32(0.0)
                if seen_a and seen_b:
                    difference = apart(looks.a, looks.b)
                told = told and difference <= portion.tolerance
                unchanged = wp.bool(False)
                if wp.static(waveform_count == 0):
                    unchanged = seen_b and difference == 0.0 and looks.at_rest and flag == 0
                if later:
                    lists.flagged[take_place(lists.flagged_count, band)] = p.at
                elif hard:
                    lists.todo[take_place(lists.todo_count, band)] = p.at
                elif told and unchanged:
                    # The keyframe's own pixel, to the last bit: nothing has changed.
                    frames[frame, row_out, column_out] = keys.image[env, y, x]
                elif told:
                    value = looks.a
                    if not seen_a:
                        value = looks.b
                    elif seen_b:
                        value += share * (looks.b - looks.a)
                    frames[frame, row_out, column_out] = radiance_of(value, portion.strength, n)
                else:
                    listed_at = first + take_place(lists.count, band)
                    lists.pixels[listed_at] = place
                    if wp.static(single):
                        shown.packed[n, y, x] = hit
                        lists.places[listed_at] = j
            else:
                frames[frame, row_out, column_out] = keys.image[env, y, x]
            if wp.static(listed):
                j += workers
            else:
                j = end

    return gather


@cache
def make_place(channels: int, single: bool = False) -> wp.Kernel:
    """Makes the kernel that writes shaded pixels into the frames; single: as of make_gather."""
    pixel = pixel_type(channels)

    @wp.kernel(module="unique", enable_backward=False)
    def place(
        # in
        workers: int,
        first: int,
        band: int,
        envs: int,
        per_env: int,
        margin: int,
        which: wp.array(dtype=int),
        pixels: wp.array(dtype=int),
        places: wp.array(dtype=int),
        count: wp.array(dtype=int),
        radiance: wp.array3d(dtype=wp.vec3),
        # out
        frames: wp.array3d(dtype=pixel),
    ):
        """Computes radiance [P E, H, W] of the listed pixels, as luminance (equation (3)) or RGB, into frames [E
        per_env, h, w], which[slot] of its environment."""
        j = wp.tid()
        width = radiance.shape[2]
        height = radiance.shape[1]
        while j < count[band]:
            at = pixels[first + j]
            x = at % width
            y = at // width % height
            n = at // (width * height)
            frame = n % envs * per_env + which[n // envs]
            y_out = y - margin
            x_out = x - margin
            colour = radiance[n, y, x]
            if wp.static(single):
                frame = wp.int32(0)
                y_out = wp.int32(0)
                x_out = places[first + j]
            if wp.static(channels == 1):
                frames[frame, y_out, x_out] = fused_luminance(colour)
            else:
                frames[frame, y_out, x_out] = colour
            j += workers

    return place
