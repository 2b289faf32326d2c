# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Adds the photoreceptor's noise to ln I of a pixel, at instants of its own and at its samples.

The process itself is in `filtered_noise_kernels.py`. Its instants are `step` ns apart from the first frame of the
episode on, whatever the frames; between them noise is a line. tau is that of the light at an instant, for the step that
begins there.
"""

import functools

import warp as wp

from evis.random_number_kernels import mix
from nodes.event_sensor.input.between_kernels import Between, further_entries, next_sample
from nodes.event_sensor.model.faults.random_kernels import stream_of
from nodes.event_sensor.model.sensor_kernels import LARGEST, has_logarithm
from nodes.event_sensor.optics.filtered_noise_kernels import make_next_value, make_stationary, make_step_of
from nodes.event_sensor.optics.photoreceptor_kernels import light_seen, make_corner_share
from nodes.event_sensor.optics.photoreceptor_simd_kernels import CONSTANT, Receptor

wp.set_module_options({"enable_backward": False})

OWN_STREAM = wp.constant(wp.uint64(0x70686F746F6E6F69))
"""Tells the photoreceptor's numbers from those of the pixel's other faults."""
LARGEST_NOISE = wp.constant(wp.float64(1.0))
"""Largest standard deviation [ln I], at which noise is as strong as the light and no small signal any more."""


@wp.struct
class Noise:
    """Holds the parameters of the noise. sigma: its standard deviation [ln I] at `level`, where the corner is `share`
    of the largest; level 0: in any light. step [ns]: from one of its instants to the next."""

    sigma: wp.float64
    level: wp.float64
    share: wp.float64
    step: wp.int64
    seed: wp.int64


@wp.struct
class Span:
    """Holds the frames of a part of a message, `count` from frame `first` on of `frames`; stamps count from the start
    of the message [ns], the part begins at `start`."""

    first: wp.int32
    count: wp.int32
    frames: wp.int32
    start: wp.int64
    stamps: wp.array(dtype=wp.int64)
    origin: wp.array(dtype=wp.int64)
    """First frame of each environment's episode, from the start of the message [ns]."""
    fresh: wp.array(dtype=wp.int32)
    episodes: wp.array(dtype=wp.int32)


@wp.struct
class NoiseState:
    """Keeps of every pixel and channel where its noise stands.

    last: its last good sample, -1: none yet. before, after: z at the last instant of the noise and at the coming one;
    first: u at the coming one, of two poles alone. entry: in a message of several parts, its next further sample.
    """

    last: wp.array(dtype=wp.float32)
    first: wp.array(dtype=wp.float64)
    before: wp.array(dtype=wp.float64)
    after: wp.array(dtype=wp.float64)
    entry: wp.array(dtype=wp.int32)


@wp.func
def sigma_at(noise: Noise, level: wp.float64, share: wp.float64):
    """Computes the standard deviation of the noise at an intensity with its dark current.

    Shot noise of a photocurrent I has the density 2 q I, that of ln I so 2 q / I; what a low pass of corner f lets
    through of it goes with f / I.
    """
    sigma = noise.sigma
    if noise.level > wp.float64(0.0):
        sigma = sigma * wp.sqrt(share / noise.share * (noise.level / level))
    return wp.min(sigma, LARGEST_NOISE)


@wp.func
def noised(level: wp.float64, ln: wp.float64):
    """Computes the light of a level with noise of `ln` [ln I]; of what exp(L) alone is, without dark current."""
    return wp.min(wp.float32(level * wp.exp(ln)), LARGEST)


@wp.func(inline=True)
def light_on_line(
    earlier: wp.float64, level: wp.float64, grown: wp.float64, start: wp.int64, now: wp.int64, instant: wp.int64
):  # fmt: skip
    """Computes the light at an instant of the line of ln I from `earlier` at `start` to `level` at `now` [ns].

    grown: ln(level / earlier). Light with its dark current.
    """
    light = wp.float64(level)
    if instant < now:
        light = earlier
        if grown != wp.float64(0.0):
            light = earlier * wp.exp(grown * (wp.float64(instant - start) / wp.float64(now - start)))
    return light


@wp.func
def instants_until(noise: Noise, origin: wp.int64, now: wp.int64):
    """Counts the instants of the noise up to `now`, those of the episode's start included; 0 before it."""
    count = wp.int64(0)
    if now >= origin:
        count = (now - origin) // noise.step + wp.int64(1)
    return count


@wp.kernel
def count_samples(
    # in
    receptor: Receptor,
    noise: Noise,
    span: Span,
    luminance: wp.array(dtype=wp.float32),
    between: Between,
    state: NoiseState,
    # out
    counts: wp.array(dtype=wp.int32),
):
    """Counts the samples of a pixel between its frames: its further ones, and the instants of the noise."""
    index = wp.tid()
    env = index // receptor.size
    inner = index - env * receptor.size
    origin = span.origin[env]
    at = wp.int64(env * span.frames + span.first) * wp.int64(receptor.size) + wp.int64(inner)
    entry, entries = further_entries(between, index)
    if span.first > 0 and entry < entries:
        entry = state.entry[index]
    begun = state.last[index] >= 0.0 and not (span.first == 0 and span.fresh[env] != 0)
    total = int(0)
    start = wp.int64(span.start)
    k = int(0)
    while k < span.count:
        inside, now, v = next_sample(
            between, index, entry, entries, span.stamps[span.first + k], luminance[at]
        )  # fmt: skip
        if begun:
            last = instants_until(noise, origin, now - wp.int64(1))
            total += wp.int32(last - instants_until(noise, origin, start))
        begun = begun or has_logarithm(v, receptor.dark)
        start = now
        if inside:
            total += 1
            entry += 1
        else:
            at += wp.int64(receptor.size)
            k += 1
    counts[index] = total


@functools.cache
def make_add_noise(poles: int, law: int) -> wp.Kernel:
    """Makes the kernel that takes a pixel a thread through a part of a message."""
    two, varying = poles == 2, law != CONSTANT
    corner_share = make_corner_share(law)
    step_of, stationary, next_value = make_step_of(poles), make_stationary(poles), make_next_value(poles)

    @wp.kernel(module="unique", enable_backward=False)
    def add_noise(
        # in
        receptor: Receptor,
        noise: Noise,
        span: Span,
        luminance: wp.array(dtype=wp.float32),
        between: Between,
        first: wp.array(dtype=wp.int32),
        # in and out
        state: NoiseState,
        # out
        frames: wp.array(dtype=wp.float32),
        offset: wp.array(dtype=wp.int32),
        value: wp.array(dtype=wp.float32),
    ):
        """Writes the frames of a part of a message and the samples between them, from first[pixel] on, with noise.

        offset: from the start of the part [ns].
        """
        index = wp.tid()
        env = index // receptor.size
        inner = index - env * receptor.size
        fresh = span.first == 0 and span.fresh[env] != 0
        at = wp.int64(env * span.frames + span.first) * wp.int64(receptor.size) + wp.int64(inner)
        to = wp.int64(env * span.count) * wp.int64(receptor.size) + wp.int64(inner)
        made = first[index]
        entry, entries = further_entries(between, index)
        if span.first > 0 and entry < entries:
            entry = state.entry[index]
        stream = mix(stream_of(noise.seed + wp.int64(env), inner, span.episodes[env]) ^ OWN_STREAM)
        origin = span.origin[env]
        last = state.last[index]
        before = state.before[index]
        after = state.after[index]
        u = wp.float64(0.0)
        if wp.static(two):
            u = state.first[index]
        number = instants_until(noise, origin, span.start)
        if fresh:
            last = float(-1.0)
            number = wp.int64(0)
            u, after = stationary(stream)
        full = receptor.rate * (wp.float64(noise.step) * wp.float64(1.0e-9))
        step = step_of(full)
        start = wp.int64(span.start)
        k = int(0)
        while k < span.count:
            inside, now, v = next_sample(
                between, index, entry, entries, span.stamps[span.first + k], luminance[at]
            )  # fmt: skip
            good = has_logarithm(v, receptor.dark)
            begun = last >= 0.0
            # Up to a bad sample the light is held at the last good one.
            level = wp.float64(0.0)
            if good:
                level = light_seen(receptor, v)
            earlier = wp.float64(level)
            if begun:
                earlier = light_seen(receptor, last)
            if not good:
                level = earlier
            grown = wp.float64(0.0)
            if level != earlier:
                grown = wp.log(level / earlier)
            instant = origin + number * noise.step
            while instant <= now:
                light = light_on_line(earlier, level, grown, start, now, instant)
                share = wp.float64(1.0)
                if begun or good:
                    share = corner_share(receptor, light)
                if begun and instant < now:
                    offset[made] = wp.int32(instant - span.start)
                    value[made] = noised(light, after * sigma_at(noise, light, share))
                    made += 1
                before = after
                number += wp.int64(1)
                if wp.static(varying):
                    step = step_of(full * share)
                u, after = next_value(step, stream, number, u, after)
                instant += noise.step
            out = wp.float32(v)
            if good:
                place = wp.float64(now - instant + noise.step) / wp.float64(noise.step)
                z = before + (after - before) * place
                out = noised(level, z * sigma_at(noise, level, corner_share(receptor, level)))
                last = v
            start = now
            if inside:
                offset[made] = wp.int32(now - span.start)
                value[made] = out
                made += 1
                entry += 1
            else:
                frames[to] = out
                at += wp.int64(receptor.size)
                to += wp.int64(receptor.size)
                k += 1
        state.last[index] = last
        state.before[index] = before
        state.after[index] = after
        if wp.static(two):
            state.first[index] = u
        if between.first.shape[0] > 0:
            state.entry[index] = entry

    return add_noise
