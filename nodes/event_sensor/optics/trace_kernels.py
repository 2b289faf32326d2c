# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Takes a pixel through its samples and writes the photoreceptor's output at them and between them.

The output is filtered at each sample as in `photoreceptor_kernels.py`; between two of them it is a curve, which
`trace_line_kernels.py` gives by samples of its own.
"""

import functools
from typing import Any

import warp as wp

from nodes.event_sensor.input.between_kernels import Between, further_entries, next_sample
from nodes.event_sensor.model.sensor_kernels import has_logarithm
from nodes.event_sensor.optics.photoreceptor_kernels import corner, halved, light_seen, make_exact_step, response
from nodes.event_sensor.optics.photoreceptor_simd_kernels import CONSTANT, PIECE, WIDEST, Receptor, make_step_alone
from nodes.event_sensor.optics.trace_line_kernels import (
    InputLine,
    Output,
    make_trace_held,
    make_trace_piece,
    make_trace_pieces,
    put,
)

wp.set_module_options({"enable_backward": False})


@functools.cache
def make_trace_step(poles: int, law: int, gpu: bool) -> Any:
    """Makes the function `trace_step`.

    On a CPU its steps have the bits of those of many pixels together, so that nothing hangs on which of both it is.
    """
    two = poles == 2
    varying = law != CONSTANT
    exact_step, step_alone = make_exact_step(poles, varying), make_step_alone(poles, law)
    trace_piece, trace_pieces, trace_held = (
        make_trace_piece(poles),
        make_trace_pieces(poles),
        make_trace_held(poles, varying),
    )

    @wp.func
    def trace_step(
        # in
        receptor: Receptor,
        chord: wp.float64,
        start: wp.int64,
        now: wp.int64,
        v: wp.float32,
        last: wp.float32,
        e1: wp.float64,
        e2: wp.float64,
        made: wp.int32,
        output: Output,
        index: wp.int32,
        last_sample: wp.array(dtype=wp.float32),
        first_pole: wp.array(dtype=wp.float64),
        second_pole: wp.array(dtype=wp.float64),
    ):
        """Filters one sample; returns the output, the last good sample, both e and the number of output samples.

        last_sample, first_pole, second_pole: used on the way where this is a CPU.
        """
        seconds = wp.float64(now - start) * wp.float64(1.0e-9)
        good = has_logarithm(v, receptor.dark)
        begun = last >= 0.0
        line = InputLine()
        line.start = start
        line.light = last
        line.e1 = e1
        line.e2 = e2
        line.made = made
        behind = e1 != wp.float64(0.0) or e2 != wp.float64(0.0)
        if begun and good and (v != last or behind):
            line.level = light_seen(receptor, last)
            if v != last:
                line.grown = wp.log(light_seen(receptor, v) / line.level)
            line.corner = receptor.rate
            after = receptor.rate
            if wp.static(varying):
                line.corner = corner(receptor, last)
                after = corner(receptor, v)
                if line.corner != after and wp.abs(line.grown) > PIECE:
                    line = trace_pieces(receptor, chord, now, line, output)
                    seconds = wp.float64(now - line.start) * wp.float64(1.0e-9)
            a = wp.float64(0.5) * (line.corner + after) * seconds
            line.made = trace_piece(
                receptor, chord, line.start, now, line.level, line.grown, a, line.e1, line.e2, line.made, output
            )  # fmt: skip
        elif begun and not good and behind:
            line.made = trace_held(receptor, chord, start, now, last, e1, e2, line.made, output)
        constant = wp.vec2d()
        if wp.static(not varying):
            constant = response(receptor.rate * seconds)
        if wp.static(not gpu):
            half = wp.float64(0.5) * receptor.rate * seconds
            if line.start == start and not (wp.static(varying) and half > WIDEST):
                last_sample[index] = last
                first_pole[index] = line.e1
                if wp.static(two):
                    second_pole[index] = line.e2
                halvings = int(0)
                if wp.static(varying):
                    half, halvings = halved(half)
                light = step_alone(
                    receptor, v, index, half, halvings, constant[0], constant[1], last_sample, first_pole, second_pole
                )  # fmt: skip
                if light >= 0.0:
                    second = line.e2
                    if wp.static(two):
                        second = second_pole[index]
                    return light, last_sample[index], first_pole[index], second, line.made
        out, seen_last, first, second = exact_step(receptor, v, line.light, line.e1, line.e2, seconds, constant)
        return out, seen_last, first, second, line.made

    return trace_step


@functools.cache
def make_trace_pixel(poles: int, law: int, gpu: bool) -> Any:
    """Makes the function `trace_pixel`."""
    two = poles == 2
    trace_step = make_trace_step(poles, law, gpu)

    @wp.func
    def trace_pixel(
        # in
        receptor: Receptor,
        chord: wp.float64,
        fresh: wp.bool,
        stamps: wp.array(dtype=wp.int64),
        luminance: wp.array(dtype=wp.float32),
        between: Between,
        index: wp.int32,
        made: wp.int32,
        keeps: wp.bool,
        # in and out
        last_sample: wp.array(dtype=wp.float32),
        first_pole: wp.array(dtype=wp.float64),
        second_pole: wp.array(dtype=wp.float64),
        # out
        filtered: wp.array(dtype=wp.float32),
        output: Output,
    ):
        """Writes the frames and the output samples of a pixel; returns how many output samples there are.

        stamps: of the frames [ns after the message's start]. made: output samples so far. keeps: the state and frames
        are written, not only counted.
        """
        count = stamps.shape[0]
        env = index // receptor.size
        at = wp.int64(env) * wp.int64(count) * wp.int64(receptor.size) + wp.int64(index - env * receptor.size)
        entry, entries = further_entries(between, index)
        last = last_sample[index]
        if fresh:
            last = float(-1.0)
        e1 = first_pole[index]
        e2 = wp.float64(0.0)
        if wp.static(two):
            e2 = second_pole[index]
        total = wp.int32(made)
        start = wp.int64(0)
        k = int(0)
        while k < count:
            inside, now, v = next_sample(between, index, entry, entries, stamps[k], luminance[at])
            out = wp.float32(v)
            if v != last or e1 != wp.float64(0.0) or e2 != wp.float64(0.0):
                out, last, e1, e2, total = trace_step(
                    receptor, chord, start, now, v, last, e1, e2, total, output,
                    index, last_sample, first_pole, second_pole,
                )  # fmt: skip
            start = now
            if inside:
                total = put(output, total, now, out)
                entry += 1
            else:
                if keeps:
                    filtered[at] = out
                at += wp.int64(receptor.size)
                k += 1
        if keeps:
            last_sample[index] = last
            first_pole[index] = e1
            if wp.static(two):
                second_pole[index] = e2
        return total

    return trace_pixel


@functools.cache
def make_trace_bent(poles: int, law: int) -> wp.Kernel:
    """Makes the kernel for a CPU, whose threads run one after the other: each goes on behind the one before."""
    two = poles == 2
    trace_pixel = make_trace_pixel(poles, law, False)

    @wp.kernel(module="unique", enable_backward=False)
    def trace_bent(
        # in
        receptor: Receptor,
        chord: wp.float64,
        fresh: wp.array(dtype=wp.int32),
        stamps: wp.array(dtype=wp.int64),
        luminance: wp.array(dtype=wp.float32),
        between: Between,
        bent: wp.array(dtype=wp.uint8),
        last_before: wp.array(dtype=wp.float32),
        first_before: wp.array(dtype=wp.float64),
        second_before: wp.array(dtype=wp.float64),
        # in and out
        last_sample: wp.array(dtype=wp.float32),
        first_pole: wp.array(dtype=wp.float64),
        second_pole: wp.array(dtype=wp.float64),
        # out
        filtered: wp.array(dtype=wp.float32),
        first: wp.array(dtype=wp.int32),
        output: Output,
    ):
        """Traces a pixel a thread, from the state before, where it is bent or has further samples.

        The others are as they were filtered. first: where output samples begin; its first entry is 0.
        """
        index = wp.tid()
        total = first[index]
        entry, entries = further_entries(between, index)
        if bent[index] != wp.uint8(0) or entry != entries:
            last_sample[index] = last_before[index]
            first_pole[index] = first_before[index]
            if wp.static(two):
                second_pole[index] = second_before[index]
            total = trace_pixel(
                receptor, chord, fresh[index // receptor.size] != 0, stamps, luminance, between, index, total, True,
                last_sample, first_pole, second_pole, filtered, output,
            )  # fmt: skip
        first[index + 1] = total

    return trace_bent


@functools.cache
def make_trace_or_count(poles: int, law: int) -> wp.Kernel:
    """Makes the kernel for a GPU, of two launches: one counts output samples, one writes them and the state."""
    trace_pixel = make_trace_pixel(poles, law, True)

    @wp.kernel(module="unique", enable_backward=False)
    def trace_or_count(
        # in
        receptor: Receptor,
        chord: wp.float64,
        fresh: wp.array(dtype=wp.int32),
        stamps: wp.array(dtype=wp.int64),
        luminance: wp.array(dtype=wp.float32),
        between: Between,
        writes: wp.bool,
        first: wp.array(dtype=wp.int32),
        # in and out
        last_sample: wp.array(dtype=wp.float32),
        first_pole: wp.array(dtype=wp.float64),
        second_pole: wp.array(dtype=wp.float64),
        # out
        filtered: wp.array(dtype=wp.float32),
        counts: wp.array(dtype=wp.int32),
        output: Output,
    ):
        """Counts the output samples of a pixel, or writes them from first[pixel] on."""
        index = wp.tid()
        made = int(0)
        if writes:
            made = first[index]
        total = trace_pixel(
            receptor, chord, fresh[index // receptor.size] != 0, stamps, luminance, between, index, made, writes,
            last_sample, first_pole, second_pole, filtered, output,
        )  # fmt: skip
        if not writes:
            counts[index] = total

    return trace_or_count
