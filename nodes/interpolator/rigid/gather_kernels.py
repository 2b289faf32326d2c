"""The sub-frames: every pixel's surface point looked up in both keyframes, and a list of those that neither shows."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.rigid.look_up_kernels import HARD, LOGS, SEEN, apart, make_look_up, radiance_of
from nodes.interpolator.rigid.room_kernels import take_place
from nodes.renderer.kernels import MISS, View, depth_of, pixel_ray, triangle_of

wp.set_module_options({"enable_backward": False})


@cache
def make_keyframe(channels: int, flicker: bool) -> Any:
    """The struct of a keyframe as `Prepared` has it, [E H W] but for image, and how the bodies [P E, N + 2] of the
    sub-frames have moved since: see displacement_kernels. channels, flicker: as of LOGS."""

    class Keyframe:
        image: wp.array3d(dtype=LOGS[channels, False])  # type: ignore[valid-type]
        patch: wp.array(dtype=int)
        support: wp.array(dtype=int)
        inverse: wp.array(dtype=float)
        logs: wp.array(dtype=LOGS[channels, flicker])
        texels: wp.array(dtype=wp.vec4)
        turn: wp.array2d(dtype=wp.mat33)
        shift: wp.array2d(dtype=wp.vec3)

    Keyframe.__qualname__ = f"Keyframe{channels}{'lit' if flicker else ''}"
    return wp.struct(Keyframe)


@cache
def make_gather(lens: str, channels: int, listed: bool, flicker: bool) -> wp.Kernel:
    """lens: `none` or a distortion model. channels: 1 (luminance) or 3 (RGB). listed: does what it is told to do, with
    care; otherwise all, and leaves the hard ones to one that is. flicker: as of LOGS."""
    Keyframe: Any = make_keyframe(channels, flicker)
    pixel = wp.float32 if channels == 1 else wp.vec3
    look_up = make_look_up(lens, channels, listed, flicker)
    # Fewer than it would take: while some threads wait for memory there must be others. With care, and of RGB, all of
    # them are worth more.
    registers = 64 if channels == 1 and not flicker and not listed else None

    @wp.kernel(module="unique", enable_backward=False, cuda_max_registers=registers)
    def gather(
        # in
        view: View,
        first: int,
        last: int,
        workers: int,
        band: int,
        slot0: int,
        envs: int,
        upsampling: int,
        tolerance: float,
        relight: int,
        index: wp.array(dtype=int),
        strength: wp.array(dtype=float),
        packed: wp.array3d(dtype=wp.uint64),
        quiet: wp.array3d(dtype=wp.uint64),
        pieces: wp.array(dtype=wp.vec2i),
        a: Keyframe,
        b: Keyframe,
        # in or out
        todo: wp.array(dtype=int),
        todo_count: wp.array(dtype=int),
        # out
        frames: wp.array3d(dtype=pixel),
        pixels: wp.array(dtype=int),
        count: wp.array(dtype=int),
    ):
        """Frames [E K, h, w] of the sub-frames in slots slot0.. of `packed` [P E, H, W]; slot s is sub-frame index[s],
        when lights that flicker have that `strength`. pieces: of each triangle, its body (the world's index being their
        number) and its patch.

        Listed: `todo` has the pixels to do, as indices into [.., E, h, w] from slot0 on; on a CPU entries first..last -
        1, on a GPU (last < 0) todo_count[band] of them, shared by `workers` threads. Otherwise a thread does one pixel;
        where `quiet` is hit nothing has changed, and what needs a careful look goes to `todo`. What no keyframe shows
        goes to `pixels` from `first` on, as indices into [P E, H, W]; count[band]: how many. So does that of which the
        keyframes differ by more than `tolerance` in log radiance, and with relight all but the sky.
        """
        width = view.width - 2 * view.margin
        height = view.height - 2 * view.margin
        m = view.margin
        j = first + wp.tid()
        end = j + 1
        if wp.static(listed):
            end = wp.where(last >= 0, last, todo_count[band])
        # The row that the pixel before was in: dividing costs as much as looking up.
        row = wp.int32(-1)
        left = wp.int32(0)
        y = wp.int32(0)
        n = wp.int32(0)
        while j < end:
            at = j
            if wp.static(listed):
                at = todo[j]
            if row < 0 or at < left or at - left >= width:
                row = at // width
                left = row * width
                y = row % height + m
                n = row // height + slot0 * envs
            x = at - left + m
            env = n % envs
            i = index[n // envs]
            frame = env * upsampling + i - 1
            hit = packed[n, y, x]
            changed = wp.bool(True)
            if wp.static(not listed):
                changed = hit != quiet[env, y, x]
            if changed:
                t = triangle_of(hit)
                d = pixel_ray(view, x, y)
                sky = t == MISS
                point = d
                body = a.turn.shape[1] - 1
                p = wp.int32(0)
                if not sky:
                    point = depth_of(hit) * d
                    piece = pieces[t]
                    body = piece[0]
                    p = piece[1]
                base = env * view.height * view.width
                m_a = a.turn[n, body] * point + a.shift[n, body]
                m_b = b.turn[n, body] * point + b.shift[n, body]
                state_a, value = look_up(
                    view,
                    base,
                    y,
                    x,
                    p,
                    sky,
                    d,
                    point,
                    m_a,
                    tolerance,
                    a.patch,
                    a.support,
                    a.inverse,
                    a.logs,
                    a.texels,
                )
                state_b, other = look_up(
                    view,
                    base,
                    y,
                    x,
                    p,
                    sky,
                    d,
                    point,
                    m_b,
                    tolerance,
                    b.patch,
                    b.support,
                    b.inverse,
                    b.logs,
                    b.texels,
                )
                seen_a = state_a == SEEN
                seen_b = state_b == SEEN
                difference = wp.float32(0.0)
                if seen_a and seen_b:
                    difference = apart(value, other)
                unchanged = wp.bool(False)
                if wp.static(not flicker):
                    unchanged = seen_b and difference == 0.0 and m_b[0] == 0.0 and m_b[1] == 0.0 and m_b[2] == 0.0
                hard = wp.bool(False)
                if wp.static(not listed):
                    hard = state_a == HARD or state_b == HARD
                if hard:
                    todo[take_place(todo_count, band)] = at
                elif relight == 1 and not sky:
                    pixels[first + take_place(count, band)] = (n * view.height + y) * view.width + x
                elif unchanged:
                    # The keyframe's own pixel, to the last bit: nothing has changed.
                    frames[frame, y - m, x - m] = b.image[env, y, x]
                elif (seen_a or seen_b) and difference <= tolerance:
                    if not seen_a:
                        value = other
                    elif seen_b:
                        value += float(i) / float(upsampling) * (other - value)
                    frames[frame, y - m, x - m] = radiance_of(value, strength[n // envs])
                else:
                    pixels[first + take_place(count, band)] = (n * view.height + y) * view.width + x
            else:
                frames[frame, y - m, x - m] = b.image[env, y, x]
            j += workers

    return gather


@cache
def make_place(channels: int) -> wp.Kernel:
    """The kernel that writes shaded pixels into the frames."""
    pixel = wp.float32 if channels == 1 else wp.vec3

    @wp.kernel(module="unique", enable_backward=False)
    def place(
        # in
        workers: int,
        first: int,
        band: int,
        envs: int,
        upsampling: int,
        margin: int,
        index: wp.array(dtype=int),
        pixels: wp.array(dtype=int),
        count: wp.array(dtype=int),
        radiance: wp.array3d(dtype=wp.vec3),
        # out
        frames: wp.array3d(dtype=pixel),
    ):
        """Radiance [P E, H, W] of the listed pixels, as luminance (equation (3)) or RGB, into frames [E K, h, w]."""
        j = wp.tid()
        width = radiance.shape[2]
        height = radiance.shape[1]
        while j < count[band]:
            at = pixels[first + j]
            x = at % width
            y = at // width % height
            n = at // (width * height)
            frame = n % envs * upsampling + index[n // envs] - 1
            colour = radiance[n, y, x]
            if wp.static(channels == 1):
                frames[frame, y - margin, x - margin] = 0.2126 * colour[0] + 0.7152 * colour[1] + 0.0722 * colour[2]
            else:
                frames[frame, y - margin, x - margin] = colour
            j += workers

    return place
