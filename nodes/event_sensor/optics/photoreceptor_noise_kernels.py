# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Computes the photoreceptor's noise of a pixel at instants of its own, and adds it to ln I there and at the samples.

White noise goes through the poles that the signal goes through. With s = dt / tau one pole of unit variance moves by

    z' = d z + sqrt(1 - d^2) x,   d = exp(-s),

and of two, the second having unit variance and the first u twice that, as of stationary noise through both,

    u' = d u + p x,   z' = d (z + s u) + q x + r y,
    p^2 = 2 (1 - d^2),   p q = 1 - d^2 (1 + 2 s),   q^2 + r^2 = 1 - d^2 (1 + 2 s + 2 s^2),

x, y being standard normal: the exact answer at any step (Uhlenbeck and Ornstein, Phys. Rev. 36, 1930; of two poles the
covariance that P - F P F' leaves, F being the step of the poles and P their covariance). Their autocorrelations are
exp(-s) and (1 + s) exp(-s). Instants are `step` ns apart from the first frame of the episode on, whatever the frames;
between them noise is a line. tau is that of the light at an instant, for the step that begins there.
"""

import functools
from typing import Any

import warp as wp

from evis.random_number_kernels import draw, mix
from nodes.event_sensor.input.between_kernels import Between, further_entries, next_sample
from nodes.event_sensor.model.faults.random_kernels import stream_of
from nodes.event_sensor.model.sensor_kernels import LARGEST, has_logarithm
from nodes.event_sensor.optics.photoreceptor_kernels import light_seen
from nodes.event_sensor.optics.photoreceptor_simd_kernels import CONSTANT, PROPORTIONAL, Receptor

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
class Step:
    """Holds the coefficients of a step, as above."""

    d: wp.float64
    s: wp.float64
    p: wp.float64
    q: wp.float64
    r: wp.float64


@wp.struct
class Poles:
    """Holds what goes on in a pixel: the light at its last good sample (-1: none yet), u and z after the coming instant
    of the noise (u of two poles alone), z before it; entry: in a message of several parts, the next of its further
    samples."""

    last: wp.array(dtype=wp.float32)
    first: wp.array(dtype=wp.float64)
    before: wp.array(dtype=wp.float64)
    after: wp.array(dtype=wp.float64)
    entry: wp.array(dtype=wp.int32)


@wp.func
def standard_normal(stream: wp.uint64, n: wp.int64):
    """Draws number n of a stream of standard normal numbers, by the inverse of their distribution, good to 1e-7.

    Wichura, algorithm AS 241 (PPND7), Applied Statistics 37(3), 1988: at half the price of Box's and Muller's way.
    """
    one = wp.float64(1.0)
    below = (wp.float64(draw(stream, n) >> wp.uint64(11)) + wp.float64(0.5)) * wp.float64(2.0**-53.0)
    q = below - wp.float64(0.5)
    r = wp.float64(0.180625) - q * q
    x = wp.float64(0.0)
    if r >= wp.float64(0.0):
        top = (wp.float64(5.9109374720e1) * r + wp.float64(1.5929113202e2)) * r + wp.float64(5.0434271938e1)
        bottom = (wp.float64(6.7187563600e1) * r + wp.float64(7.8757757664e1)) * r + wp.float64(1.7895169469e1)
        x = q * (top * r + wp.float64(3.3871327179)) / (bottom * r + one)
    else:
        r = wp.sqrt(-wp.log(wp.min(below, one - below)))
        if r <= wp.float64(5.0):
            r = r - wp.float64(1.6)
            top = (wp.float64(1.7023821103e-1) * r + wp.float64(1.3067284816)) * r + wp.float64(2.7568153900)
            x = (top * r + wp.float64(1.4234372777)) / (
                (wp.float64(1.2021132975e-1) * r + wp.float64(7.3700164250e-1)) * r + one
            )
        else:
            r = r - wp.float64(5.0)
            top = (wp.float64(1.7337203997e-2) * r + wp.float64(4.2868294337e-1)) * r + wp.float64(3.0812263860)
            x = (top * r + wp.float64(6.6579051150)) / (
                (wp.float64(1.2258202635e-2) * r + wp.float64(2.4197894225e-1)) * r + one
            )
        if q < wp.float64(0.0):
            x = -x
    return x


@functools.cache
def make_step_of(poles: int) -> Any:
    """Makes the function of the coefficients of a step."""
    two = poles == 2

    @wp.func
    def step_of(s: wp.float64):
        """Computes the coefficients of a step of s = dt / tau."""
        one = wp.float64(1.0)
        found = Step()
        found.s = s
        found.d = wp.exp(-s)
        left = wp.exp(wp.float64(-2.0) * s)
        found.p = wp.sqrt(one - left)
        if wp.static(two):
            found.p = wp.sqrt(wp.float64(2.0) * (one - left))
            if found.p > wp.float64(0.0):
                found.q = (one - left * (one + wp.float64(2.0) * s)) / found.p
            rest = one - left * (one + wp.float64(2.0) * s * (one + s)) - found.q * found.q
            # Rounding may leave less than nothing of s^3 / 3.
            found.r = wp.sqrt(wp.max(rest, wp.float64(0.0)))
        return found

    return step_of


@functools.cache
def make_share_of(law: int) -> Any:
    """Makes the function of the corner's share."""
    varying, powered = law != CONSTANT, law not in (CONSTANT, PROPORTIONAL)

    @wp.func
    def share_of(receptor: Receptor, level: wp.float64):
        """Computes the corner at an intensity with its dark current, as a share of the largest."""
        share = wp.float64(1.0)
        if wp.static(varying):
            share = wp.min(share, level / receptor.level)
            if wp.static(powered):
                share = wp.pow(share, receptor.exponent)
        return share

    return share_of


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


@wp.func
def instants_until(span: Span, noise: Noise, origin: wp.int64, now: wp.int64):
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
    poles: Poles,
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
        entry = poles.entry[index]
    begun = poles.last[index] >= 0.0 and not (span.first == 0 and span.fresh[env] != 0)
    total = int(0)
    start = wp.int64(span.start)
    k = int(0)
    while k < span.count:
        inside, now, v = next_sample(
            between, index, entry, entries, span.stamps[span.first + k], luminance[at]
        )  # fmt: skip
        if begun:
            last = instants_until(span, noise, origin, now - wp.int64(1))
            total += wp.int32(last - instants_until(span, noise, origin, start))
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
    step_of, share_of = make_step_of(poles), make_share_of(law)

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
        poles: Poles,
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
            entry = poles.entry[index]
        stream = mix(stream_of(noise.seed + wp.int64(env), inner, span.episodes[env]) ^ OWN_STREAM)
        origin = span.origin[env]
        last = poles.last[index]
        before = poles.before[index]
        after = poles.after[index]
        u = wp.float64(0.0)
        if wp.static(two):
            u = poles.first[index]
        number = instants_until(span, noise, origin, span.start)
        if fresh:
            last = float(-1.0)
            number = wp.int64(0)
            after = standard_normal(stream, wp.int64(0))
            if wp.static(two):
                u = wp.sqrt(wp.float64(2.0)) * after
                after = wp.sqrt(wp.float64(0.5)) * (after + standard_normal(stream, wp.int64(1)))
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
                light = wp.float64(level)
                if instant < now:
                    light = earlier
                    if grown != wp.float64(0.0):
                        light = earlier * wp.exp(grown * (wp.float64(instant - start) / wp.float64(now - start)))
                share = wp.float64(1.0)
                if begun or good:
                    share = share_of(receptor, light)
                if begun and instant < now:
                    offset[made] = wp.int32(instant - span.start)
                    value[made] = noised(light, after * sigma_at(noise, light, share))
                    made += 1
                before = after
                number += wp.int64(1)
                if wp.static(varying):
                    step = step_of(full * share)
                if wp.static(two):
                    x = standard_normal(stream, number + number)
                    y = standard_normal(stream, number + number + wp.int64(1))
                    after = step.d * (after + step.s * u) + step.q * x + step.r * y
                    u = step.d * u + step.p * x
                else:
                    after = step.d * after + step.p * standard_normal(stream, number)
                instant += noise.step
            out = wp.float32(v)
            if good:
                place = wp.float64(now - instant + noise.step) / wp.float64(noise.step)
                z = before + (after - before) * place
                out = noised(level, z * sigma_at(noise, level, share_of(receptor, level)))
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
        poles.last[index] = last
        poles.before[index] = before
        poles.after[index] = after
        if wp.static(two):
            poles.first[index] = u
        if between.first.shape[0] > 0:
            poles.entry[index] = entry

    return add_noise
