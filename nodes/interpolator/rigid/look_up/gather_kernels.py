"""The sub-frames: every pixel's surface point looked up in both keyframes, and a list of those that neither shows.

On a GPU three kernels do this, each of which lists what it leaves to the next ones: what most pixels need takes few
registers, so that many threads wait for memory at once. The first goes through all pixels, the second does those that
light may change on, and the last one looks with care at what is beside an edge. On a CPU the last one does all that is
listed.
"""

from functools import cache
from typing import Any, Literal

import warp as wp

from evis.gpu.append_kernels import take_place
from evis.gpu.division_kernels import Divisor, divided, divisor
from evis.gpu.reading_kernels import entry, vector_at, whole_number
from nodes.interpolator.displacement_kernels import displaced
from nodes.interpolator.relight.change_kernels import Change, Displacements, make_asked, make_relit, point_of
from nodes.interpolator.relight.features import LightChanges
from nodes.interpolator.rigid.look_up.log_kernels import LOGS, apart, brighter, fused_luminance, radiance_of
from nodes.interpolator.rigid.look_up.look_up_kernels import (
    BARE,
    HARD,
    HIDDEN,
    SEEN,
    Sight,
    make_keyframes,
    make_look_up,
)
from nodes.interpolator.rigid.look_up.texture_kernels import make_log_albedo
from nodes.renderer.raster.depth_kernels import MISS, depth_of, triangle_of
from nodes.renderer.raster.lens.view_kernels import CameraView, pixel_ray
from nodes.renderer.raster.surface_kernels import Seen, Surfaces, pixel_at

wp.set_module_options({"enable_backward": False})


@wp.struct
class Portion:
    """Holds instants that are looked up together: those in `count` slots from slot0 on of `packed` [P E, H, W]; slot
    s is at index[s] / upsampling of the gap and frame[s] of `frames` in each environment's output, and lights that
    flicker have that `strength` then, [P E].

    quiet [E, H, W]: z-buffer entries with which nothing has changed. pieces: of each triangle, its body (the world's
    index being their number) and its patch. tolerance: difference of the keyframes' log radiance up to which it is
    blended; pace: path [px] per unit of `index` from which on what is finer than a keyframe's pixels does not matter;
    relight: 1 where all but the sky is to be shaded anew. keyframes: first rows of A and B in their pair. by_width,
    by_height [px], by_count, by_envs: what indices of pixels of frames are divided by, see `cut`.
    """

    slot0: int
    envs: int
    frames: int
    upsampling: int
    tolerance: float
    pace: float
    relight: int
    count: int
    keyframes: wp.vec2i
    by_width: Divisor
    by_height: Divisor
    by_count: Divisor
    by_envs: Divisor
    index: wp.array(dtype=int)
    frame: wp.array(dtype=int)
    strength: wp.array(dtype=float)
    packed: wp.array3d(dtype=wp.uint64)
    quiet: wp.array3d(dtype=wp.uint64)
    pieces: wp.array(dtype=wp.vec2i)


def cut(portion: Any, width: int, height: int) -> None:
    """Fills in what indices of a portion's pixels are divided by. width, height [px]: of a frame without margin."""
    portion.by_width, portion.by_height = divisor(width), divisor(height)
    portion.by_count, portion.by_envs = divisor(portion.count), divisor(portion.envs)


@wp.func
def sight_of(view: CameraView, hit: wp.uint64, y: int, x: int, pieces: wp.array(dtype=wp.vec2i), sky: int):
    """Gives what a pixel shows, and its body; sky: the index that stands for it."""
    s = Sight()
    s.y = y
    s.x = x
    s.d = pixel_ray(view, x, y)
    s.point = s.d
    s.sky = 1
    body = sky
    t = triangle_of(hit)
    if t != MISS:
        s.sky = 0
        s.point = depth_of(hit) * s.d
        piece = pieces[t]
        body = piece[0]
        s.patch = piece[1]
    return s, body


@cache
def make_gather(
    lens: str,
    channels: int,
    flicker: bool,
    look: Literal["first", "flagged", "careful"],
    changes: LightChanges,
    detailed: bool,
    kind: tuple[bool, bool, bool] | None,
    fast: bool,
    single: bool = False,
) -> wp.Kernel:
    """Makes the kernel that looks up the pixels of sub-frames in both keyframes.

    lens: `none` or a distortion model. channels: 1 (luminance) or 3 (RGB). flicker: as of LOGS. look: `first` goes
    through all pixels and lists those that light may change on; `flagged` does these; both list what needs care, and
    `careful` does whatever is listed. changes: of light in the scene. detailed: as of make_look_up. kind: whether the
    scene has textures, shading normals of its own and colours at vertices, if textures are looked up at their own time.
    fast: as of the renderer's Features. single: pixels are listed one by one: what they see and
    their radiance stand where they do in the list, not in images.
    """
    listed, careful = look != "first", look == "careful"
    log_albedo = make_log_albedo(*kind) if kind and careful else None
    relit, asked = (make_relit(changes), make_asked(changes)) if changes.any else (None, None)
    Keyframes: Any = make_keyframes(channels, flicker)
    pixel = wp.float32 if channels == 1 else wp.vec3
    looked_up: Any = LOGS[channels, flicker]
    look_up = make_look_up(lens, channels, flicker, careful, detailed, kind is not None)
    # Fewer than it would take, but of RGB: while some threads wait for memory there must be others.
    registers = (64 if look == "first" else 128) if channels == 1 and not flicker else None

    @wp.func
    def lit_otherwise(
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
        moves.turn = keys.turn
        moves.shift = keys.shift
        moves.at = at
        moves.behind = behind
        row_a = portion.keyframes[0] + env
        row_b = portion.keyframes[1] + env
        return relit(change, flag, n, row_a, row_b, s, moves, seen_a, seen_b, share)

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
        shown: Seen,
        surfaces: Surfaces,
        # in or out
        flagged: wp.array(dtype=int),
        flagged_count: wp.array(dtype=int),
        todo: wp.array(dtype=int),
        todo_count: wp.array(dtype=int),
        # out
        frames: wp.array3d(dtype=pixel),
        pixels: wp.array(dtype=int),
        places: wp.array(dtype=int),
        count: wp.array(dtype=int),
    ):
        """Computes the frames [E frames, h, w] of a portion.

        First: a thread does one pixel; those that light may change on go to `flagged`, as indices into [.., E, h, w]
        from slot0 on. Flagged: `workers` threads share flagged_count[band] of these. Both leave to `todo` what needs
        care. Careful: on a CPU entries first..last - 1 of that, on a GPU (last < 0) todo_count[band], shared likewise.
        What no keyframe shows goes to `pixels` from `first` on, as indices into [P E, H, W]; count[band]: how many. So
        does that of which the keyframes differ by more than the tolerance in log radiance. Single pixels: entries
        first..last - 1 of `todo`, todo_count[band] at most; portion.packed and frames are [1, 1, list]; z-buffers of
        what is listed in `pixels` are written to those that are shown, and `places` says where they were listed.
        """
        width = view.width - 2 * view.margin
        height = view.height - 2 * view.margin
        m = view.margin
        envs = portion.envs
        j = first + wp.tid()
        end = j + 1
        if wp.static(single):
            end = wp.min(last, first + todo_count[band])
        elif wp.static(careful):
            end = wp.where(last >= 0, last, todo_count[band])
        elif wp.static(listed):
            end = flagged_count[band]
        # The row that the pixel before was in, which need not be found again.
        row = wp.int32(-1)
        left = wp.int32(0)
        y = wp.int32(0)
        slot = wp.int32(0)
        env = wp.int32(0)
        while j < end:
            at = j
            x = wp.int32(0)
            anew = wp.bool(False)
            if wp.static(listed):
                if wp.static(careful):
                    at = todo[j]
                    if at < 0:
                        at = -1 - at
                        anew = True
                else:
                    at = flagged[j]
                if row < 0 or at < left or at - left >= width:
                    row = divided(at, portion.by_width)
                    left = row * width
                    image = divided(row, portion.by_height)
                    y = row - image * height + m
                    slot = divided(image, portion.by_envs)
                    env = image - slot * envs
                x = at - left + m
            else:
                # A row of one sub-frame after that of the other: they look for nearly the same places.
                row = divided(j, portion.by_width)
                line = divided(row, portion.by_count)
                slot = row - line * portion.count
                env = divided(line, portion.by_height)
                y = line - env * height
                left = j - row * width
                at = ((slot * envs + env) * height + y) * width + left
                x = left + m
                y += m
            n = (portion.slot0 + slot) * envs + env
            i = whole_number(portion.index, portion.slot0 + slot)
            frame = env * portion.frames + whole_number(portion.frame, portion.slot0 + slot)
            place = (n * view.height + y) * view.width + x
            hit = wp.uint64(0)
            row_out = y - m
            column_out = x - m
            if wp.static(single):
                hit = entry(portion.packed, j)
                frame = wp.int32(0)
                row_out = wp.int32(0)
                column_out = j
            else:
                hit = entry(portion.packed, place)
            changed = wp.bool(True)
            if wp.static(not listed):
                changed = hit != entry(portion.quiet, (env * view.height + y) * view.width + x)
            if anew:
                pixels[first + take_place(count, band)] = place
            elif changed:
                s, body = sight_of(view, hit, y, x, portion.pieces, keys.turn.shape[1] - 1)
                base = env * view.height * view.width
                since = n * keys.turn.shape[1] + body
                behind = keys.turn.shape[0] / 2 * keys.turn.shape[1]
                flag = wp.int32(0)
                if wp.static(changes.any):
                    if s.sky == 0:
                        to_a = vector_at(keys.shift, since)
                        to_b = vector_at(keys.shift, since + behind)
                        flag = asked(change, body, env, n, hit, s.point, to_a, to_b)
                later = wp.bool(False)
                if wp.static(not listed):
                    later = flag != 0
                state_a = wp.int32(HIDDEN)
                state_b = wp.int32(HIDDEN)
                value = looked_up(0.0)
                other = looked_up(0.0)
                at_rest = wp.bool(False)
                # A, then B, by the same code: two copies would not fit a GPU's registers and cache of instructions.
                for k in range(wp.where(later, 0, 2)):
                    before = k == 0
                    moved = displaced(keys.turn, keys.shift, since + k * behind, s.point)
                    origin = base + wp.where(before, keys.first[0], keys.first[1])
                    distant = portion.pace * float(wp.where(before, i, portion.upsampling - i))
                    state, found = look_up(view, keys, origin, s, moved, portion.tolerance, distant)
                    if before:
                        state_a = state
                        value = found
                    else:
                        state_b = state
                        other = found
                        at_rest = moved[0] == 0.0 and moved[1] == 0.0 and moved[2] == 0.0
                if wp.static(log_albedo is not None):
                    if state_a == BARE or state_b == BARE:
                        if wp.static(single):
                            shown.packed[n, y, x] = hit
                        texture = log_albedo(view, pixel_at(n, y, x), shown, surfaces)
                        if texture == 0.0:
                            state_a = wp.where(state_a == BARE, HIDDEN, state_a)
                            state_b = wp.where(state_b == BARE, HIDDEN, state_b)
                        if state_a == BARE:
                            state_a = wp.int32(SEEN)
                            value += texture
                        if state_b == BARE:
                            state_b = wp.int32(SEEN)
                            other += texture
                seen_a = state_a == SEEN
                seen_b = state_b == SEEN
                share = float(i) / float(portion.upsampling)
                hard = wp.bool(False)
                if wp.static(not careful):
                    hard = state_a == HARD or state_b == HARD
                told = (seen_a or seen_b) and (s.sky == 1 or portion.relight == 0)
                if wp.static(listed and changes.any):
                    if told and flag != 0 and not hard:
                        otherwise, above_a, above_b = lit_otherwise(
                            change, portion, keys, flag, n, env, hit, since, behind, s.point, seen_a, seen_b, share
                        )
                        told = not otherwise
                        if wp.static(changes.relative):
                            value = brighter(value, above_a)
                            other = brighter(other, above_b)
                difference = wp.float32(0.0)
                if seen_a and seen_b:
                    difference = apart(value, other)
                told = told and difference <= portion.tolerance
                unchanged = wp.bool(False)
                if wp.static(not flicker):
                    unchanged = seen_b and difference == 0.0 and at_rest and flag == 0
                if later:
                    flagged[take_place(flagged_count, band)] = at
                elif hard:
                    todo[take_place(todo_count, band)] = at
                elif told and unchanged:
                    # The keyframe's own pixel, to the last bit: nothing has changed.
                    frames[frame, row_out, column_out] = keys.image[env, y, x]
                elif told:
                    if not seen_a:
                        value = other
                    elif seen_b:
                        value += share * (other - value)
                    strength = wp.float32(1.0)
                    if wp.static(flicker):
                        strength = portion.strength[n]
                    frames[frame, row_out, column_out] = radiance_of(value, strength)
                else:
                    listed_at = first + take_place(count, band)
                    pixels[listed_at] = place
                    if wp.static(single):
                        shown.packed[n, y, x] = hit
                        places[listed_at] = j
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
    pixel = wp.float32 if channels == 1 else wp.vec3

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
