"""Computes the photoreceptor's output along a line of its input: a curve, given by as many samples as lines between
them need.

Between two input samples L is a line, and with s = (t - t0) / tau, G = dL/dt tau, A = e1 + G and B = e2 + 2 G the poles
are behind it by

    e1(s) = A exp(-s) - G,   e2(s) = (B + A s) exp(-s) - 2 G,

so the output L + e bends by A exp(-s), or (B + A s - 2 A) exp(-s), and a chord over ds lies at most ds^2 / 8 of its
largest value there beside it. Output samples are set as far apart as keeps that below `chord`. Where the corner follows
the light, and the light changes much between two samples, the input's line is cut into pieces first, so that 1 / tau is
nearly constant in each.
"""

import functools
from typing import Any

import warp as wp

from nodes.event_sensor.model.sensor_kernels import LARGEST
from nodes.event_sensor.optics.photoreceptor_kernels import corner, light_seen, poles_after, response
from nodes.event_sensor.optics.photoreceptor_simd_kernels import PIECE, Receptor

wp.set_module_options({"enable_backward": False})

MOST_PIECES = wp.constant(wp.float64(256.0))
LAST_OFFSET = wp.constant(wp.int64(0x7FFFFFFF))


@wp.struct
class Output:
    """Holds the samples made so far: their number, and room for so many; offset [ns], value."""

    room: wp.int32
    offset: wp.array(dtype=wp.int32)
    value: wp.array(dtype=wp.float32)


@wp.func
def put(output: Output, made: wp.int32, now: wp.int64, light: wp.float32):
    """Writes output sample number `made`, where there is room for it; returns how many there are."""
    if made < output.room:
        output.offset[made] = wp.int32(now)
        output.value[made] = light
    return made + 1


@wp.func
def light_of(receptor: Receptor, level: wp.float64, behind: wp.float64):
    """Computes the intensity of a level exp(L), behind which the output is by `behind`."""
    return wp.clamp(wp.float32(level * wp.exp(behind) - receptor.dark), 0.0, LARGEST)


@functools.cache
def make_trace_piece(poles: int) -> Any:
    """Makes the function `trace_piece`."""
    two = poles == 2

    @wp.func
    def trace_piece(
        # in
        receptor: Receptor,
        chord: wp.float64,
        start: wp.int64,
        end: wp.int64,
        level: wp.float64,
        grown: wp.float64,
        a: wp.float64,
        e1: wp.float64,
        e2: wp.float64,
        made: wp.int32,
        output: Output,
    ):
        """Writes the output between `start` and `end` [ns]; returns how many output samples there are.

        level: exp(L) of the input at the start. grown: dL of the piece, whose length is `a` in tau.
        """
        count = wp.int32(made)
        # A and B times a, which need no division.
        first = e1 * a + grown
        second = e2 * a + wp.float64(2.0) * grown
        bend = wp.abs(first)
        if wp.static(two):
            bend = wp.abs(second - wp.float64(2.0) * first) + a * wp.abs(first)
        if bend * a > wp.float64(8.0) * chord and end <= LAST_OFFSET:
            length = wp.float64(end - start)
            least = a / length  # a nanosecond
            g = grown / a
            first = first / a
            second = second / a
            s = wp.float64(0.0)
            here = wp.int64(start)
            while s < a:
                decay = wp.exp(-s)
                step = a
                if wp.static(two):
                    now_bends = wp.abs(second + first * (s - wp.float64(2.0))) * decay
                    tilt = wp.abs(first) * decay
                    left = wp.abs(second + first * s) * decay + tilt
                    if left > chord and now_bends * a * a > wp.float64(4.0) * chord:
                        step = wp.sqrt(wp.float64(4.0) * chord / now_bends)
                    if left > chord and tilt * step * step * step > wp.float64(4.0) * chord:
                        step = wp.pow(wp.float64(4.0) * chord / tilt, wp.float64(1.0 / 3.0))
                else:
                    now_bends = wp.abs(first) * decay
                    # What is left of it bends no more than that.
                    if now_bends > chord and now_bends * a * a > wp.float64(8.0) * chord:
                        step = wp.sqrt(wp.float64(8.0) * chord / now_bends)
                s += wp.max(step, least)
                now = start + wp.int64(s / a * length)
                if s < a and now > here and now < end:
                    here = now
                    place = wp.float64(now - start) / length
                    u = place * a
                    e = first * wp.exp(-u) - g
                    if wp.static(two):
                        e = (second + first * u) * wp.exp(-u) - wp.float64(2.0) * g
                    count = put(output, count, now, light_of(receptor, level, grown * place + e))
        return count

    return trace_piece


@wp.struct
class InputLine:
    """Holds the rest of a line of the input between two samples, and what is there where it begins.

    start [ns]; light and level = exp(L); corner [1/s]; grown: dL up to the line's end. e1, e2: how far the poles are
    behind. made: output samples so far.
    """

    start: wp.int64
    light: wp.float32
    level: wp.float64
    corner: wp.float64
    grown: wp.float64
    e1: wp.float64
    e2: wp.float64
    made: wp.int32


@functools.cache
def make_trace_pieces(poles: int) -> Any:
    """Makes the function `trace_pieces`."""
    two = poles == 2
    trace_piece = make_trace_piece(poles)

    @wp.func
    def trace_pieces(receptor: Receptor, chord: wp.float64, end: wp.int64, line: InputLine, output: Output):
        """Writes the output along all pieces of a line but the last, which ends at the sample at `end` [ns]; returns
        the line's last piece."""
        rest = line
        whole = wp.float64(end - line.start)
        pieces = wp.min(wp.ceil(wp.abs(line.grown) / PIECE), wp.min(MOST_PIECES, whole))
        if end > LAST_OFFSET:
            pieces = wp.float64(1.0)
        j = wp.float64(1.0)
        while j < pieces:
            to = line.start + wp.int64(whole * j / pieces)
            part = line.grown * (wp.float64(to - rest.start) / whole)
            seen = light_of(receptor, rest.level, part)
            there = corner(receptor, seen)
            a = wp.float64(0.5) * (rest.corner + there) * wp.float64(to - rest.start) * wp.float64(1.0e-9)
            made = trace_piece(
                receptor, chord, rest.start, to, rest.level, part, a, rest.e1, rest.e2, rest.made, output
            )  # fmt: skip
            e1, e2 = poles_after(rest.e1, rest.e2, part, a, response(a), wp.static(two))
            behind = e1
            if wp.static(two):
                behind = e2
            rest.level = rest.level * wp.exp(part)
            rest.made = put(output, made, to, light_of(receptor, rest.level, behind))
            rest.start = to
            rest.light = seen
            rest.corner = there
            rest.e1 = e1
            rest.e2 = e2
            j += wp.float64(1.0)
        rest.grown = line.grown * (wp.float64(end - rest.start) / whole)
        return rest

    return trace_pieces


@functools.cache
def make_trace_held(poles: int, varying: bool) -> Any:
    """Makes the function `trace_held`."""
    two = poles == 2
    trace_piece = make_trace_piece(poles)

    @wp.func
    def trace_held(
        receptor: Receptor,
        chord: wp.float64,
        start: wp.int64,
        now: wp.int64,
        last: wp.float32,
        e1: wp.float64,
        e2: wp.float64,
        made: wp.int32,
        output: Output,
    ):
        """Writes the output up to a bad sample; returns how many output samples there are.

        The input is held at the last good sample while the output goes on, and the bad sample itself cannot tell how
        far.
        """
        count = wp.int32(made)
        to = now - wp.int64(1)
        if to > start and to <= LAST_OFFSET:
            zero = wp.float64(0.0)
            level = light_seen(receptor, last)
            a = receptor.rate
            if wp.static(varying):
                a = corner(receptor, last)
            a *= wp.float64(to - start) * wp.float64(1.0e-9)
            count = trace_piece(receptor, chord, start, to, level, zero, a, e1, e2, count, output)
            held_first, held_second = poles_after(e1, e2, zero, a, response(a), wp.static(two))
            behind = held_first
            if wp.static(two):
                behind = held_second
            count = put(output, count, to, light_of(receptor, level, behind))
        return count

    return trace_held
