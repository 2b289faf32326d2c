"""Merges the samples of the sub-pixels of each pixel into one list of samples of their mean."""

from functools import cache
from typing import Any

import warp as wp

from nodes.interpolator.image_kernels import pixel_type
from nodes.interpolator.refine.frame_kernels import light_at_start
from nodes.interpolator.rigid.keyframe_kernels import log_of

wp.set_module_options({"enable_backward": False})

UNBOUNDED = wp.constant(1.0e30)
"""Slope [1/ns] that is steeper than any."""
BEND = wp.constant(32.0)
"""A mean of exponentials whose exponents rise by up to d differently lies at most d^2 / 32 under the line between its
ends: its second derivative is the variance of the slopes, at most d^2 / 4, and a line is off by an eighth of that."""
MOST_PIECES = wp.constant(64)
"""Pieces that an interval between two instants is cut into at most: lines that rise yet more differently are jumps."""


@wp.struct
class Division:
    """Describes the sub-pixels of a gap: fineness x fineness for each of height x width pixels, with K frames.

    each: instants from one frame to the next. finest: time [ns] between two samples of a mean where no sub-pixel has
    one. tolerance: of ln of the mean. margin: sub-pixels around keyframe A.
    """

    fineness: int
    height: int
    width: int
    coarse: int
    each: int
    finest: int
    margin: int
    tolerance: float


@wp.func
def rise(a: wp.float32, b: wp.float32):
    """Computes ln of the ratio of two lights, 0 where one is black; in RGB of each channel."""
    return wp.where(a > 0.0 and b > 0.0 and a != b, wp.log(b / a), 0.0)


@wp.func
def rise(a: wp.vec3, b: wp.vec3):  # noqa: F811 - overloaded by its type
    return wp.vec3(rise(a[0], b[0]), rise(a[1], b[1]), rise(a[2], b[2]))


@wp.func
def between(a: wp.float32, b: wp.float32, share: float):
    """Computes the light at a share of the way from a to b along a line of ln I, or of I where one is black."""
    if a > 0.0 and b > 0.0:
        if a == b:
            return a
        return a * wp.exp(share * wp.log(b / a))
    return a + share * (b - a)


@wp.func
def between(a: wp.vec3, b: wp.vec3, share: float):  # noqa: F811 - overloaded by its type
    return wp.vec3(between(a[0], b[0], share), between(a[1], b[1], share), between(a[2], b[2], share))


@wp.func
def greatest(value: wp.float32):
    """Gives the greatest of the channels."""
    return value


@wp.func
def greatest(value: wp.vec3):  # noqa: F811 - overloaded by its type
    return wp.max(value)


@wp.func
def within(value: wp.float32, low: wp.float32, high: wp.float32):
    """Tells whether all channels are between their bounds; what is no number is not."""
    return value >= low and value <= high


@wp.func
def within(value: wp.vec3, low: wp.vec3, high: wp.vec3):  # noqa: F811 - overloaded by its type
    return within(value[0], low[0], high[0]) and within(value[1], low[1], high[1]) and within(value[2], low[2], high[2])


@wp.struct
class Block:
    """Names the sub-pixels of a pixel, and the coarse interval k that they are looked at in.

    env: environment. y, x: of the first sub-pixel in a frame. p: its number among all. row: sub-pixels in a row of a
    frame. t_a, t_b: ends of the coarse interval [ns from the gap's start].
    """

    env: int
    y: int
    x: int
    p: int
    row: int
    k: int
    t_a: int
    t_b: int


@wp.func
def block_of(division: Division, q: int):
    """Gives the Block of pixel q."""
    n = division.fineness
    block = Block()
    block.env = q // (division.height * division.width)
    block.y = q // division.width % division.height * n
    block.x = q % division.width * n
    block.row = division.width * n
    block.p = (block.env * division.height * n + block.y) * block.row + block.x
    return block


@cache
def make_subpixel_light(channels: int) -> Any:
    """Makes the struct of what is known of the light of sub-pixels; channels: as of make_merge.

    image_a: keyframe A, with its margin. frames: [E K, h, w]. first, offset, value: further samples, as of Further.
    cursor: the next sample of each.
    """
    pixel = pixel_type(channels)

    class SubpixelLight:
        image_a: wp.array3d(dtype=pixel)
        frames: wp.array3d(dtype=pixel)
        first: wp.array(dtype=int)
        offset: wp.array(dtype=int)
        value: wp.array(dtype=pixel)
        cursor: wp.array(dtype=int)

    SubpixelLight.__qualname__ = f"SubpixelLight{channels}"
    return wp.struct(SubpixelLight)


@wp.func
def pass_samples(division: Division, block: Block, end: int, light: Any):
    """Moves the cursors of all sub-pixels on, past their samples up to `end`; light: SubpixelLight."""
    for j in range(division.fineness):
        for i in range(division.fineness):
            p = block.p + j * block.row + i
            at = light.cursor[p]
            while at < light.first[p + 1] and light.offset[at] <= end:
                at += 1
            light.cursor[p] = at


@cache
def make_line_of(channels: int) -> wp.Function:
    """Makes the function `line_of`. channels: as of make_merge."""
    SubpixelLight: Any = make_subpixel_light(channels)

    @wp.func
    def line_of(
        division: Division,
        block: Block,
        j: int,
        i: int,
        light: SubpixelLight,
    ):
        """Gives the ends (time, light) of the line that the sub-pixel in row j and column i of a block is on: samples
        of its own, or frames."""
        p = block.p + j * block.row + i
        y = block.y + j
        x = block.x + i
        at = light.cursor[p]
        a = light_at_start(light.image_a, light.frames, division.coarse, division.margin, block.env, block.k, y, x)
        b = light.frames[block.env * division.coarse + block.k, y, x]
        start = block.t_a
        end = block.t_b
        if at > light.first[p]:
            if light.offset[at - 1] > block.t_a:
                start = light.offset[at - 1]
                a = light.value[at - 1]
        if at < light.first[p + 1]:
            if light.offset[at] < block.t_b:
                end = light.offset[at]
                b = light.value[at]
        return start, a, end, b

    return line_of


@cache
def make_slopes(channels: int) -> wp.Function:
    """Makes the function `slopes`. channels: as of make_merge."""
    pixel = pixel_type(channels)
    SubpixelLight: Any = make_subpixel_light(channels)
    line_of = make_line_of(channels)

    @wp.func
    def slopes(
        division: Division,
        block: Block,
        light: SubpixelLight,
    ):
        """Gives the least and the greatest slope of the lines that sub-pixels are on [1/ns], and when the first of
        these ends [ns]."""
        n = division.fineness
        least = pixel(UNBOUNDED)
        most = pixel(-UNBOUNDED)
        end = wp.int32(block.t_b)
        for j in range(n):
            for i in range(n):
                start_t, start, end_t, stop = line_of(division, block, j, i, light)
                slope = rise(start, stop) / float(end_t - start_t)
                least = wp.min(least, slope)
                most = wp.max(most, slope)
                end = wp.min(end, end_t)
        return least, most, end

    return slopes


@cache
def make_mean_at(channels: int) -> wp.Function:
    """Makes the function `mean_at`. channels: as of make_merge."""
    pixel = pixel_type(channels)
    SubpixelLight: Any = make_subpixel_light(channels)
    line_of = make_line_of(channels)

    @wp.func
    def mean_at(
        division: Division,
        block: Block,
        when: int,
        light: SubpixelLight,
    ):
        """Computes the mean of the sub-pixels' lines at a time [ns]."""
        n = division.fineness
        total = pixel(0.0)
        for j in range(n):
            for i in range(n):
                start_t, start, end_t, stop = line_of(division, block, j, i, light)
                total += between(start, stop, float(when - start_t) / float(end_t - start_t))
        return total / float(n * n)

    return mean_at


@cache
def make_merge(channels: int) -> wp.Kernel:
    """Makes the kernel `merge`, of a thread per pixel. channels: 1 (luminance) or 3 (RGB)."""
    pixel = pixel_type(channels)
    SubpixelLight: Any = make_subpixel_light(channels)
    slopes = make_slopes(channels)
    mean_at = make_mean_at(channels)

    @wp.kernel(module="unique", enable_backward=False)
    def merge(
        # in
        q0: int,
        division: Division,
        writes: int,
        held: wp.array(dtype=int),
        since: wp.array2d(dtype=int),
        # in and out
        light: SubpixelLight,
        places: wp.array(dtype=int),
        # out
        instants: wp.array(dtype=int),
        means: wp.array(dtype=pixel),
    ):
        """Counts the samples of the mean of pixel q, from q0 on, in places[q + 1], or writes them, from places[q] on.

        They are at the instants of all its sub-pixels, and where lines of these between them do not add up to a line,
        but for those that lie within the tolerance of the line between two others.

        held: 1 for environments that have no gap. since: [E, instants], ns from the gap's start.
        """
        q = q0 + wp.tid()
        block = block_of(division, q)
        if held[block.env] == 1:
            return
        n = division.fineness
        for j in range(n):
            for i in range(n):
                light.cursor[block.p + j * block.row + i] = light.first[block.p + j * block.row + i]
        made = wp.int32(0)
        for k in range(division.coarse):
            block.k = k
            block.t_a = 0
            if k > 0:
                block.t_a = since[block.env, k * division.each - 1]
            block.t_b = since[block.env, (k + 1) * division.each - 1]
            total = pixel(0.0)
            for j in range(n):
                for i in range(n):
                    total += light_at_start(
                        light.image_a,
                        light.frames,
                        division.coarse,
                        division.margin,
                        block.env,
                        k,
                        block.y + j,
                        block.x + i,
                    )
            # Samples since the last one that stays are left out while a line from it keeps near all of them: its slope
            # must be within what each of them allows.
            anchor_t = wp.int32(block.t_a)
            anchor = log_of(total / float(n * n))
            low = pixel(-UNBOUNDED)
            high = pixel(UNBOUNDED)
            waiting_t = wp.int32(-1)
            waiting = pixel(0.0)
            t = wp.int32(block.t_a)
            while t < block.t_b:
                least, most, end = slopes(division, block, light)
                apart = greatest(most - least) * float(end - t)
                pieces = wp.int32(1)
                if wp.isfinite(apart):
                    wanted = wp.int32(wp.ceil(wp.min(apart / wp.sqrt(BEND * division.tolerance), float(MOST_PIECES))))
                    pieces = wp.max(wp.min(wanted, (end - t) // division.finest), 1)
                for piece in range(1, pieces + 1):
                    when = t + wp.int32(wp.int64(end - t) * wp.int64(piece) // wp.int64(pieces))
                    mean = mean_at(division, block, when, light)
                    slope = (log_of(mean) - anchor) / float(when - anchor_t)
                    if waiting_t >= 0 and not within(slope, low, high):
                        if writes == 1:
                            instants[places[q] + made] = waiting_t
                            means[places[q] + made] = waiting
                        made += 1
                        anchor_t = waiting_t
                        anchor = log_of(waiting)
                        low = pixel(-UNBOUNDED)
                        high = pixel(UNBOUNDED)
                        slope = (log_of(mean) - anchor) / float(when - anchor_t)
                    room = pixel(division.tolerance / float(when - anchor_t))
                    low = wp.max(low, slope - room)
                    high = wp.min(high, slope + room)
                    waiting_t = when
                    waiting = mean
                pass_samples(division, block, end, light)
                t = end
        if writes == 0:
            places[q + 1] = made

    return merge
