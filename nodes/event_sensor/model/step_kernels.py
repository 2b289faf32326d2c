"""Pieces of a step, with just the features asked for: its curve, whether it is surely quiet, the band it leaves."""

from functools import lru_cache
from typing import Any

import warp as wp

from nodes.event_sensor.model.curve_kernels import (
    SHARPNESS,
    butland,
    cubic_slopes,
    end_slopes,
    known_slopes,
    parabola_bend,
)
from nodes.event_sensor.model.inactive_kernels import Quiet
from nodes.event_sensor.model.pixel_kernels import (
    LARGEST,
    TOLERANCE,
    UNKNOWN_SLOPES,
    Sensor,
    band,
    least,
    log_level,
    valid,
)
from nodes.event_sensor.model.random_kernels import LONGEST, NEVER, PHASE, draw, mix, stream_of, uniform, waiting_time
from nodes.event_sensor.model.state_kernels import NOWHERE, Features, Hot

wp.set_module_options({"enable_backward": False})

REST = wp.constant(wp.float64(64.0))
"""Steps that a leaking pixel shall rest for, where the threshold is far enough."""
UNKNOWN = wp.constant(wp.float64(1.0 / 16.0))
"""Of the way to the threshold, left to the leak at an episode's start, where nobody knows how the signal moves."""


@wp.func
def shot_accepted(mark: wp.float64, light: wp.float64, sensor: Sensor):
    """The paper's law: rate = shot_rate (1 - clip(I / white, 0, 1)), by thinning."""
    return mark < wp.float64(1.0) - wp.clamp(light / sensor.white, wp.float64(0.0), wp.float64(1.0))


@wp.func
def slope_of(sensor: Sensor, dlog_dt: wp.float32, intensity: wp.float32):
    """dL/dt [1/s] of L = ln(I + I_dark) from d ln I/dt; NaN where it is not known."""
    light = wp.float64(intensity)
    return wp.float32(wp.float64(dlog_dt) * light / (light + sensor.dark))


@wp.func
def stream_here(sensor: Sensor, env: wp.int32, inner: wp.int32, episodes: wp.array2d(dtype=wp.int32), k: wp.int32):
    """The stream of a pixel in the episode of frame k."""
    return stream_of(sensor.seed + wp.int64(env), inner, episodes[wp.min(k, 1), env])


@wp.func
def noise_candidate(
    sensor: Sensor, stream: wp.uint64, draws: wp.int64, rate: wp.float64, hot_share: wp.float64, light: wp.float64
):
    """Candidate number `draws` of the noise: whether it fires, whether ON, and the wait for the next [ns].

    Odd draws are marks (what the candidate is), even ones waiting times.
    """
    bits = draw(stream, wp.int64(2) * draws + wp.int64(1))
    mark = uniform(bits)
    on = (mix(bits) & wp.uint64(1)) != wp.uint64(0)
    fires = bool(True)
    if mark >= hot_share:
        fires = shot_accepted((mark - hot_share) / (wp.float64(1.0) - hot_share), light, sensor)
    wait = waiting_time(draw(stream, wp.int64(2) * (draws + wp.int64(1))), rate)
    return fires, on, wait


@wp.func
def coin_time(stream: wp.uint64, leak: wp.float32, start: wp.int64, now: wp.int64):
    """When a leak that is a coin per step fires in (start, now], or NEVER."""
    bits = mix(stream ^ mix(wp.uint64(now)))
    length = wp.float64(now - start)
    when = NEVER
    if uniform(bits) < wp.float64(leak) * length * wp.float64(1.0e-9):
        place = uniform(mix(bits)) * length
        when = start + wp.int64(1) + wp.int64(wp.min(place, wp.float64(now - start - wp.int64(1))))
    return when


@wp.func
def leak_origin(stream: wp.uint64, leak: wp.float32, now: wp.int64):
    """When a pixel whose episode begins at `now` was last reset by its leak [Hz]: less than 1 / leak before."""
    origin = now
    if leak > 0.0:
        age = uniform(draw(stream, PHASE)) / wp.float64(leak) * wp.float64(1.0e9)
        origin = now - wp.int64(wp.min(age, LONGEST))
    return origin


@wp.func
def candidate_after(
    here: wp.int64, stream: wp.uint64, candidate: wp.int64, draws: wp.int64, rate: wp.float64
):  # fmt: skip
    """The first candidate of the noise that is later than `here`, and its number."""
    following = candidate
    number = draws
    while following <= here:
        number = number + wp.int64(1)
        following = following + waiting_time(draw(stream, wp.int64(2) * number), rate)
    return following, number


@wp.func
def crossed(delta: wp.float64, c_on: wp.float64, c_off: wp.float64, one: wp.bool):
    """How many thresholds lie within `delta` of the reference, at most 1 where `one`; the threshold with its sign."""
    up = delta > wp.float64(0.0)
    c = wp.where(up, c_on, c_off)
    far = wp.abs(delta) + TOLERANCE
    n = wp.int32(far >= c)
    if not one:
        n = wp.int32(far / c)
    return n, wp.where(up, c, -c)


@wp.func
def reference_of(base: wp.float64, net: wp.int32, n_off: wp.int32, c_on: wp.float64, c_off: wp.float64):
    return base + wp.float64(net) * c_on + wp.float64(n_off) * (c_on - c_off)


@wp.func
def take(quiet: Quiet, index: wp.int32):
    """A pixel's state."""
    hot = Hot()
    hot.last = quiet.last[index]
    hot.low = quiet.low[index]
    hot.high = quiet.high[index]
    if index < quiet.early.shape[0]:
        hot.early = quiet.early[index]
        hot.earlier = quiet.earlier[index]
    if index < quiet.wake.shape[0]:
        hot.wake = quiet.wake[index]
    return hot


@wp.func
def put(quiet: Quiet, index: wp.int32, hot: Hot):
    """Store a pixel's state, as far as there is room for it."""
    quiet.last[index] = hot.last
    quiet.low[index] = hot.low
    quiet.high[index] = hot.high
    if index < quiet.early.shape[0]:
        quiet.early[index] = hot.early
        quiet.earlier[index] = hot.earlier
    if index < quiet.wake.shape[0]:
        quiet.wake[index] = hot.wake


@lru_cache
def step_curve(features: Features) -> Any:
    """Function: the curve L(u), u in [0, 1], of a step, and L of the samples earlier, early, next as far as known."""
    cubic, hermite = features.crossing == "cubic", features.crossing == "hermite"
    ahead = features.ahead

    @wp.func
    def curve(
        # in
        sensor: Sensor,
        hot: Hot,
        l_earlier: wp.float64,
        l_early: wp.float64,
        l0: wp.float64,
        l1: wp.float64,
        slope: wp.float32,
        following: wp.float32,
        has_next: wp.bool,
        h: wp.float64,
        h_before: wp.float64,
        h_after: wp.float64,
        # out
        counters: wp.array(dtype=wp.int64),
    ):
        """l0, l1: L at both ends. h, h_before, h_after: lengths of the step and of its neighbours [ns]."""
        zero = wp.float64(0.0)
        l_next = NOWHERE
        d = l1 - l0
        s = wp.vec4d(l0, d, zero, zero)
        m = wp.vec2d(d, d)
        if wp.static(hermite):
            g0 = wp.float64(hot.early) * h * wp.float64(1.0e-9)
            g1 = wp.float64(slope) * h * wp.float64(1.0e-9)
            g_before = wp.float64(hot.earlier) * h * wp.float64(1.0e-9)
            if not wp.isfinite(g1):
                wp.atomic_add(counters, UNKNOWN_SLOPES, wp.int64(1))
                g1 = d
            if not wp.isfinite(g0):
                g0 = d
            m = known_slopes(g_before, g0, g1, d)
        if wp.static(ahead):
            has_early = hot.early >= 0.0
            d_before = zero
            if has_early:
                if l_early == NOWHERE:
                    l_early = log_level(sensor, hot.early)
                d_before = l0 - l_early
            d_after = zero
            if has_next:
                l_next = l1
                if valid(sensor, following):
                    l_next = log_level(sensor, following)
                d_after = l_next - l1
            if has_early:
                m[0] = h * butland(d_before, d, h_before, h)
            if has_next:
                m[1] = h * butland(d, d_after, h, h_after)
            if wp.static(cubic):
                sharp = SHARPNESS * m + (wp.float64(1.0) - SHARPNESS) * wp.vec2d(d, d)
                if has_early and has_next:
                    bend0 = parabola_bend(d_before, d, h_before, h)
                    # What came before is unknown at an episode's start; take it for a corner.
                    bend_before = -bend0
                    if hot.earlier >= 0.0:
                        if l_earlier == NOWHERE:
                            l_earlier = log_level(sensor, hot.earlier)
                        bend_before = d_before - (l_early - l_earlier)
                    m = cubic_slopes(bend_before, bend0, parabola_bend(-d_after, -d, h_after, h), d_before, d, sharp)
                elif has_early:
                    m = end_slopes(parabola_bend(d_before, d, h_before, h), d, sharp)
                elif has_next:
                    m = end_slopes(parabola_bend(-d_after, -d, h_after, h), d, sharp)
        s[1] = m[0]
        s[2] = wp.float64(3.0) * d - wp.float64(2.0) * m[0] - m[1]
        s[3] = m[0] + m[1] - wp.float64(2.0) * d
        return s, l_earlier, l_early, l_next

    return curve


@lru_cache
def surely_quiet(features: Features) -> Any:
    """Function: whether a step whose samples lie in the band has its whole curve there."""
    cubic, hermite = features.crossing == "cubic", features.crossing == "hermite"

    @wp.func
    def curve_quiet(
        sensor: Sensor, hot: Hot, v: wp.float32, slope: wp.float32, following: wp.float32, length: wp.int64
    ):
        dark = wp.float32(sensor.dark)
        quiet = bool(True)
        if wp.static(cubic):
            # The curve runs over the four samples by a quarter of their range at most: ln(1 + x) <= x.
            a = wp.min(wp.min(v, following), wp.min(hot.last, hot.early)) + dark
            b = wp.max(wp.max(v, following), wp.max(hot.last, hot.early)) + dark
            quiet = quiet and hot.early >= 0.0 and valid(sensor, following)
            quiet = quiet and b * (3.0 * a + b) <= 4.0 * a * (hot.high + dark)
            quiet = quiet and 4.0 * a * a >= (3.0 * a + b) * (hot.low + dark)
        if wp.static(hermite):
            # The curve lies within its Bezier points, a third of the slopes beyond the samples: e^x <= 1 + x + x^2.
            third = wp.max(wp.abs(slope), wp.abs(hot.early)) * wp.float32(length) * 3.4e-10
            over = 1.0 + third + third * third
            quiet = quiet and slope == slope and hot.early == hot.early and third < 1.0
            quiet = quiet and (wp.max(v, hot.last) + dark) * over <= hot.high + dark
            quiet = quiet and wp.min(v, hot.last) + dark >= (hot.low + dark) * over
        return quiet

    return curve_quiet


@lru_cache
def band_left(features: Features) -> Any:
    """Function: the band in which nothing can happen before `wake`."""
    leak, noise, refractory = features.leak, features.noise, features.refractory

    @wp.func
    def rest(
        sensor: Sensor,
        reference: wp.float64,
        c_on: wp.float64,
        c_off: wp.float64,
        drift: wp.float64,
        now: wp.int64,
        length: wp.int64,
        l_last: wp.float64,
        moved: wp.float64,
        following: wp.int64,
        dead: wp.int64,
    ):
        """reference: less the drift up to now. length, moved: of the step [ns, ln I]. following: next noise candidate.

        Returns low, high, wake.
        """
        zero = wp.float64(0.0)
        top = reference + c_on
        wake = NEVER
        if wp.static(leak):
            gap = top - l_last
            if drift > zero and gap > zero:
                # Some of the way to the threshold is left to the drift, the rest to the signal: half of it where the
                # signal rests, as much as the drift does until the signal is there where it moves on.
                step = drift * wp.float64(length)
                share = UNKNOWN * gap
                if step > zero:
                    share = wp.max(gap * step / (moved + wp.float64(2.0) * step), REST * step)
                    share = wp.min(share, wp.float64(0.5) * gap)
                wake = now + wp.int64(wp.min(share / drift, LONGEST))
                top = top - share
        if wp.static(noise):
            wake = wp.min(wake, following)
        limits = band(sensor, wp.exp(wp.float32(reference - c_off)), wp.exp(wp.float32(top)))
        low = limits[0]
        high = limits[1]
        if wp.static(refractory):
            if dead > now:
                low = least(sensor)
                high = LARGEST
                wake = dead
        return low, high, wake

    return rest
