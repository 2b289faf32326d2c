# ruff: noqa: RUF046, UP018 - int(0) is how a Warp kernel declares a variable that changes
"""The sensor with curves between frames and with faults, in the order of time; only what is asked for is compiled.

A pixel's life inside a step goes from one happening to the next: a crossing, a candidate of its noise process, the end
of its dead time, the end of the step. Leak is a drift of the reference, here of the signal instead, S(t) = L(t) +
rate C_on (t - origin), against a reference that stands still, so that crossings stay roots of the same polynomial. A
noise event resets the pixel as any event does: the reference becomes S at its time.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import warp as wp

from nodes.event_sensor.kernels import (
    DROPPED,
    EVENTS,
    LARGEST,
    NONFINITE,
    TOLERANCE,
    UNKNOWN_SLOPES,
    Sensor,
    band,
    count_clipped,
    key_head,
    key_tail,
    least,
    log_level,
    valid,
)
from nodes.event_sensor.kernels_curve import (
    at,
    butland,
    crossing,
    cubic_slopes,
    known_slopes,
    parabola_bend,
    to_square,
    turning_points,
)
from nodes.event_sensor.kernels_noise import NEVER, draw, mix, stream_of, uniform, waiting_time

wp.set_module_options({"enable_backward": False})

ALIVE = wp.constant(wp.int64(-0x7FFFFFFFFFFFFFFF))
NOWHERE = wp.constant(wp.float64(1.0e300))
"""An L that is not known."""


@dataclass(frozen=True)
class Features:
    """What is compiled: one kernel for each set."""

    crossing: str
    leak: bool = False
    coin: bool = False
    noise: bool = False
    refractory: bool = False
    mismatch: bool = False
    cap: bool = False


@wp.struct
class Hot:
    """What every step looks at. Intensities in [low, high] cannot fire before `wake`; low infinite: no reference yet.

    early, earlier: the samples before `last` (cubic, monotone; negative: unknown), or the slopes dL/dt [1/s] at `last`
    and before (hermite). side: which of the two cold states is this one's.
    """

    last: wp.float32
    low: wp.float32
    high: wp.float32
    early: wp.float32
    earlier: wp.float32
    side: wp.int32
    wake: wp.int64


@wp.struct
class Cold:
    """What only a step with something in it looks at; the reference is as in Pixel."""

    base: wp.float64
    net: wp.int32
    n_off: wp.int32
    origin: wp.int64  # where the leak's drift is zero
    dead: wp.int64  # end of the dead time
    next: wp.int64  # next candidate of the noise process
    draws: wp.int64  # its number


@wp.func
def emit(
    sensor: Sensor,
    key: wp.int64,
    written: wp.int32,
    cap: wp.bool,
    keys: wp.array(dtype=wp.int64),
    counters: wp.array(dtype=wp.int64),
):
    """One event. written: events of this pixel in this step so far."""
    if cap and written >= sensor.cap:
        wp.atomic_add(counters, DROPPED, wp.int64(1))
    else:
        slot = wp.atomic_add(counters, EVENTS, wp.int64(1))
        if slot < sensor.capacity:
            keys[slot] = key


@wp.func
def shot_accepted(mark: wp.float64, light: wp.float64, sensor: Sensor):
    """The paper's law: rate = shot_rate (1 - clip(I / white, 0, 1)), by thinning."""
    return mark < wp.float64(1.0) - wp.clamp(light / sensor.white, wp.float64(0.0), wp.float64(1.0))


@wp.func
def slope_of(sensor: Sensor, dlog_dt: wp.float32, intensity: wp.float32):
    """dL/dt [1/s] of L = ln(I + I_dark) from d ln I/dt; NaN where it is not known."""
    light = wp.float64(intensity)
    return wp.float32(wp.float64(dlog_dt) * light / (light + sensor.dark))


@lru_cache
def full_kernels(features: Features) -> tuple[Any, Any]:
    """(kernel over rows, kernel over pixels) with just these features."""
    frame = features.crossing == "frame"
    cubic = features.crossing == "cubic"
    monotone = features.crossing == "monotone"
    hermite = features.crossing == "hermite"
    ahead = cubic or monotone
    curved = ahead or hermite
    leak, coin, noise = features.leak, features.coin, features.noise
    refractory, mismatch, cap = features.refractory, features.mismatch, features.cap
    timed = leak or noise or refractory
    spontaneous = noise or coin

    @wp.func
    def sense(
        # in
        sensor: Sensor,
        env: wp.int32,
        y: wp.int32,
        x: wp.int32,
        c: wp.int32,
        begin: wp.int32,
        episodes: wp.array2d(dtype=wp.int32),
        luminance: wp.array(dtype=wp.float32),
        dlog_dt: wp.array(dtype=wp.float32),
        frames: wp.int32,
        count: wp.int32,
        t: wp.array(dtype=wp.int64),
        t_base: wp.int64,
        t_before: wp.int64,
        thresholds_on: wp.array(dtype=wp.float32),
        thresholds_off: wp.array(dtype=wp.float32),
        leaks: wp.array(dtype=wp.float32),
        hots: wp.array(dtype=wp.float32),
        before: wp.array(dtype=Hot),
        # out
        after: wp.array(dtype=Hot),
        colds: wp.array2d(dtype=Cold),
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        zero = wp.float64(0.0)
        one = wp.float64(1.0)
        size = sensor.height * sensor.width * sensor.channels
        inner = (y * sensor.width + x) * sensor.channels + c
        index = env * size + inner
        first = wp.int64(env) * wp.int64(frames) * wp.int64(size) + wp.int64(inner)
        stride = wp.int64(size)
        hot = before[index]
        start = t_base
        start_before = t_before
        k = int(0)
        if wp.static(not curved and not coin):
            # Most pixels are quiet through the whole message: the short way.
            if begin == 0:
                last = hot.last
                while k < count:
                    sample = luminance[first + wp.int64(k) * stride]
                    if not (sample >= hot.low and sample <= hot.high):
                        break
                    if wp.static(timed):
                        if t[k] >= hot.wake:
                            break
                    last = sample
                    k += 1
                hot.last = last
                if k == count:
                    after[index] = hot
                    return
                if k > 0:
                    start = t[k - 1]
        cold = Cold()
        loaded = bool(False)
        c_on = sensor.threshold_on
        c_off = sensor.threshold_off
        if wp.static(mismatch):
            c_on = wp.float64(thresholds_on[index])
            c_off = wp.float64(thresholds_off[index])
        drift = zero  # of S [1/ns]
        if wp.static(leak):
            drift = wp.float64(leaks[index]) * c_on * wp.float64(1.0e-9)
        dark = wp.float32(sensor.dark)
        rate = sensor.shot_rate
        hot_share = zero
        if wp.static(noise):
            rate = rate + wp.float64(hots[index])
            hot_share = wp.float64(hots[index]) / wp.max(rate, wp.float64(1.0e-300))
        stream = wp.uint64(0)
        named = bool(False)  # the stream is known
        l_last = NOWHERE
        l_early = NOWHERE
        l_earlier = NOWHERE
        l_next = NOWHERE
        while k < count:
            v = luminance[first + wp.int64(k) * stride]
            now = t[k]
            begins = k < 2 and ((begin >> k) & 1) != 0
            if begins:
                hot.low = float(wp.inf)
                named = False
            following = v
            has_next = bool(False)
            if wp.static(ahead):
                has_next = k + 1 < frames and not (k == 0 and (begin & 2) != 0)
                if has_next:
                    following = luminance[first + wp.int64(k + 1) * stride]
            slope = wp.float32(0.0)
            if wp.static(hermite):
                slope = slope_of(sensor, dlog_dt[first + wp.int64(k) * stride], v)
            quiet = v >= hot.low and v <= hot.high
            if wp.static(timed):
                quiet = quiet and now < hot.wake
            if wp.static(cubic):
                # The curve runs over the four samples by a quarter of their range at most: ln(1 + x) <= x.
                a = wp.min(wp.min(v, following), wp.min(hot.last, hot.early)) + dark
                b = wp.max(wp.max(v, following), wp.max(hot.last, hot.early)) + dark
                quiet = quiet and hot.early >= 0.0 and valid(sensor, following)
                quiet = quiet and b * (3.0 * a + b) <= 4.0 * a * (hot.high + dark)
                quiet = quiet and 4.0 * a * a >= (3.0 * a + b) * (hot.low + dark)
            if wp.static(hermite):
                # The curve lies within its Bezier points, a third of the slopes beyond the samples: e^x <= 1 + x + x^2.
                third = wp.max(wp.abs(slope), wp.abs(hot.early)) * wp.float32(now - start) * 3.4e-10
                over = 1.0 + third + third * third
                quiet = quiet and slope == slope and hot.early == hot.early and third < 1.0
                quiet = quiet and (wp.max(v, hot.last) + dark) * over <= hot.high + dark
                quiet = quiet and wp.min(v, hot.last) + dark >= (hot.low + dark) * over
            coin_at = NEVER
            if wp.static(coin):
                if not begins and hot.low <= LARGEST:
                    if not named:
                        stream = stream_of(sensor.seed + wp.int64(env), inner, episodes[wp.min(k, 1), env])
                        named = True
                    bits = mix(stream ^ mix(wp.uint64(now)))
                    chance = wp.float64(leaks[index]) * wp.float64(now - start) * wp.float64(1.0e-9)
                    if uniform(bits) < chance:
                        place = uniform(mix(bits)) * wp.float64(now - start)
                        coin_at = start + wp.int64(1) + wp.int64(wp.min(place, wp.float64(now - start - wp.int64(1))))
                        quiet = False
            if not quiet:
                held = not valid(sensor, v)
                if held:
                    wp.atomic_add(counters, NONFINITE, wp.int64(1))
                if not loaded:
                    cold = colds[hot.side, index]
                    loaded = True
                if hot.low > LARGEST:
                    if not held:
                        count_clipped(sensor, v, counters)
                        cold.base = log_level(sensor, v)
                        cold.net = 0
                        cold.n_off = 0
                        cold.origin = now
                        cold.dead = ALIVE
                        cold.next = NEVER
                        cold.draws = wp.int64(0)
                        if wp.static(noise):
                            stream = stream_of(sensor.seed + wp.int64(env), inner, episodes[wp.min(k, 1), env])
                            named = True
                            if rate > zero:
                                cold.next = now + waiting_time(draw(stream, wp.int64(0)), rate)
                        l_last = cold.base
                        l_early = NOWHERE
                        l_earlier = NOWHERE
                        l_next = NOWHERE
                        hot.last = v
                        hot.low = 0.0
                        if wp.static(ahead):
                            hot.early = -1.0
                            hot.earlier = -1.0
                        if wp.static(hermite):
                            hot.early = slope
                            hot.earlier = float(wp.nan)
                else:
                    if held:
                        v = hot.last
                        slope = 0.0
                    count_clipped(sensor, v, counters)
                    length = now - start
                    h = wp.float64(length)
                    # -- the curve S(u), u in [0, 1] --------------------------------------------------------------
                    if l_last == NOWHERE:
                        l_last = log_level(sensor, hot.last)
                    l0 = l_last
                    l1 = l_next
                    if l1 == NOWHERE:
                        l1 = log_level(sensor, v)
                    l_next = NOWHERE
                    d = l1 - l0
                    shift = drift * wp.float64(start - cold.origin)
                    s = wp.vec4d(l0 + shift, d, zero, zero)
                    if wp.static(frame):
                        s[1] = zero
                    if wp.static(curved):
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
                            if not wp.isfinite(g_before):
                                g_before = g0
                            m = known_slopes(g_before, g0, g1, d)
                        if wp.static(ahead):
                            has_early = hot.early >= 0.0
                            h_before = wp.float64(start - start_before)
                            d_before = zero
                            if has_early:
                                if l_early == NOWHERE:
                                    l_early = log_level(sensor, hot.early)
                                d_before = l0 - l_early
                            h_after = one
                            d_after = zero
                            if has_next:
                                l_next = l1
                                if valid(sensor, following):
                                    l_next = log_level(sensor, following)
                                d_after = l_next - l1
                                h_after = wp.float64(t[k + 1] - now)
                            if wp.static(cubic):
                                bend0 = zero
                                bend1 = zero
                                bend_before = zero
                                if has_early:
                                    bend0 = parabola_bend(d_before, d, h_before, h)
                                    # What came before is unknown at an episode's start; take it for a corner.
                                    bend_before = -bend0
                                    if hot.earlier >= 0.0:
                                        if l_earlier == NOWHERE:
                                            l_earlier = log_level(sensor, hot.earlier)
                                        bend_before = d_before - (l_early - l_earlier)
                                if has_next:
                                    bend1 = parabola_bend(-d_after, -d, h_after, h)
                                # At either end of what is known the curve is the other end's parabola, kept monotone.
                                if not has_early:
                                    bend0 = bend1
                                if not has_next:
                                    bend1 = bend0
                                m = cubic_slopes(bend_before, bend0, bend1, d)
                                if not (has_early and has_next):
                                    m = wp.vec2d(to_square(m[0], d), to_square(m[1], d))
                            else:
                                if has_early:
                                    m[0] = h * butland(d_before, d, h_before, h)
                                if has_next:
                                    m[1] = h * butland(d, d_after, h, h_after)
                        s[1] = m[0]
                        s[2] = wp.float64(3.0) * d - wp.float64(2.0) * m[0] - m[1]
                        s[3] = m[0] + m[1] - wp.float64(2.0) * d
                    if wp.static(leak):
                        s[1] = s[1] + drift * h
                    turns = wp.vec2d(wp.float64(2.0), wp.float64(2.0))
                    if wp.static(curved):
                        turns = turning_points(s)
                    # -- the happenings ---------------------------------------------------------------------------
                    reference = (
                        cold.base + wp.float64(cold.net) * c_on + wp.float64(cold.n_off) * (c_on - c_off)
                    )  # fmt: skip
                    head = key_head(sensor, env)
                    tail_on = key_tail(sensor, y, x, c, True)
                    tail_off = key_tail(sensor, y, x, c, False)
                    u = zero
                    here = start
                    fired = int(0)
                    going = bool(True)
                    while going:
                        if wp.static(refractory):
                            if cold.dead != ALIVE:
                                if cold.dead > now:
                                    break
                                # Released: the pixel was held in reset, so its reference is what it sees now.
                                here = wp.max(cold.dead, start)
                                cold.dead = ALIVE
                                u = wp.float64(here - start) / h
                                cold.base = at(s, u)
                                if wp.static(frame):
                                    if here == now:
                                        cold.base = l1 + drift * wp.float64(now - cold.origin)
                                cold.net = 0
                                cold.n_off = 0
                                reference = cold.base
                                if wp.static(noise):
                                    if cold.next <= here:
                                        if not named:
                                            stream = stream_of(
                                                sensor.seed + wp.int64(env), inner, episodes[wp.min(k, 1), env]
                                            )
                                            named = True
                                        while cold.next <= here:
                                            cold.draws = cold.draws + wp.int64(1)
                                            bits = draw(stream, wp.int64(2) * cold.draws)
                                            cold.next = cold.next + waiting_time(bits, rate)
                                if wp.static(coin):
                                    if coin_at <= here:
                                        coin_at = NEVER
                        until = now
                        by_noise = bool(False)
                        if wp.static(spontaneous):
                            candidate = wp.min(cold.next, coin_at)
                            if candidate <= now:
                                until = candidate
                                by_noise = True
                        u_end = one
                        if by_noise:
                            u_end = wp.float64(until - start) / h
                        died = bool(False)
                        while u < u_end and not died:
                            piece = u_end
                            if wp.static(curved):
                                if turns[1] > u and turns[1] < piece:
                                    piece = turns[1]
                                if turns[0] > u and turns[0] < piece:
                                    piece = turns[0]
                            delta = at(s, piece) - reference
                            on = delta > zero
                            step = wp.where(on, c_on, c_off)
                            n = wp.int32((wp.abs(delta) + TOLERANCE) / step)
                            if n > 0:
                                signed = wp.where(on, step, -step)
                                tail = wp.where(on, tail_on, tail_off)
                                if wp.static(refractory):
                                    n = wp.min(n, 1)
                                j = int(0)
                                while j < n:
                                    level = reference + wp.float64(j + 1) * signed
                                    if wp.static(curved):
                                        root = crossing(s, level, u, piece)
                                    else:
                                        root = piece
                                        if s[1] != zero:
                                            root = wp.clamp((level - s[0]) / s[1], u, piece)
                                    ns = start + wp.max(wp.int64(root * h + wp.float64(0.5)), wp.int64(1))
                                    here = wp.clamp(ns, here, until)
                                    key = head | ((here - t_base) << sensor.shift_t) | tail
                                    emit(sensor, key, fired, wp.static(cap), keys, counters)
                                    fired += 1
                                    j += 1
                                cold.net = cold.net + wp.where(on, n, -n)
                                cold.n_off = cold.n_off + wp.where(on, 0, n)
                                reference = reference + wp.float64(n) * signed
                                if wp.static(refractory):
                                    cold.dead = here + sensor.dead_ns
                                    died = True
                            u = piece
                        if not died:
                            going = False
                            if wp.static(spontaneous):
                                if by_noise:
                                    going = True
                                    here = until
                                    u = u_end
                                    fires = bool(True)
                                    on = bool(True)
                                    if until == coin_at:
                                        coin_at = NEVER
                                    else:
                                        if not named:
                                            stream = stream_of(
                                                sensor.seed + wp.int64(env), inner, episodes[wp.min(k, 1), env]
                                            )
                                            named = True
                                        # Odd draws are marks (what the candidate is), even ones waiting times.
                                        bits = draw(stream, wp.int64(2) * cold.draws + wp.int64(1))
                                        mark = uniform(bits)
                                        on = (mix(bits) & wp.uint64(1)) != wp.uint64(0)
                                        if mark >= hot_share:
                                            light = wp.float64(hot.last)
                                            if wp.static(not frame):
                                                light += u * (wp.float64(v) - light)
                                            mark = (mark - hot_share) / (one - hot_share)
                                            fires = shot_accepted(mark, light, sensor)
                                        cold.draws = cold.draws + wp.int64(1)
                                        bits = draw(stream, wp.int64(2) * cold.draws)
                                        cold.next = until + waiting_time(bits, rate)
                                    if fires:
                                        key = head | ((until - t_base) << sensor.shift_t)
                                        key = key | wp.where(on, tail_on, tail_off)
                                        emit(sensor, key, fired, wp.static(cap), keys, counters)
                                        fired += 1
                                        cold.base = at(s, u)
                                        if wp.static(frame):
                                            if until == now:
                                                cold.base = l1 + drift * wp.float64(now - cold.origin)
                                        cold.net = 0
                                        cold.n_off = 0
                                        reference = cold.base
                                        if wp.static(refractory):
                                            cold.dead = until + sensor.dead_ns
                    if wp.static(frame):
                        # The signal jumps at the frame's stamp.
                        if cold.dead <= now:
                            delta = l1 + drift * wp.float64(now - cold.origin) - reference
                            on = delta > zero
                            step = wp.where(on, c_on, c_off)
                            n = wp.int32((wp.abs(delta) + TOLERANCE) / step)
                            if wp.static(refractory):
                                n = wp.min(n, 1)
                            key = head | ((now - t_base) << sensor.shift_t) | wp.where(on, tail_on, tail_off)
                            j = int(0)
                            while j < n:
                                emit(sensor, key, fired, wp.static(cap), keys, counters)
                                fired += 1
                                j += 1
                            cold.net = cold.net + wp.where(on, n, -n)
                            cold.n_off = cold.n_off + wp.where(on, 0, n)
                            if wp.static(refractory):
                                if n > 0:
                                    cold.dead = now + sensor.dead_ns
                    if wp.static(ahead):
                        hot.earlier = hot.early
                        hot.early = hot.last
                        l_earlier = l_early
                        l_early = l0
                    if wp.static(hermite):
                        hot.earlier = hot.early
                        hot.early = slope
                    hot.last = v
                    l_last = l1
                # -- the band in which nothing can happen before hot.wake -----------------------------------------
                if hot.low <= LARGEST:
                    reference = (
                        cold.base + wp.float64(cold.net) * c_on + wp.float64(cold.n_off) * (c_on - c_off)
                        - drift * wp.float64(now - cold.origin)
                    )  # fmt: skip
                    top = reference + c_on
                    hot.wake = NEVER
                    if wp.static(leak):
                        gap = top - l_last
                        if drift > zero and gap > zero:
                            # Half of the way to the threshold is left to the drift, half to the signal.
                            wait = wp.min(wp.float64(0.5) * gap / drift, wp.float64(4.0e18))
                            hot.wake = now + wp.int64(wait)
                            top = top - wp.float64(0.5) * gap
                    if wp.static(noise):
                        hot.wake = wp.min(hot.wake, cold.next)
                    limits = band(
                        sensor,
                        wp.exp(wp.float32(reference - c_off)),
                        wp.exp(wp.float32(top)),
                    )
                    hot.low = limits[0]
                    hot.high = limits[1]
                    if wp.static(refractory):
                        if cold.dead > now:
                            hot.low = least(sensor)
                            hot.high = LARGEST
                            hot.wake = cold.dead
            else:
                if wp.static(ahead):
                    hot.earlier = hot.early
                    hot.early = hot.last
                if wp.static(hermite):
                    hot.earlier = hot.early
                    hot.early = slope
                hot.last = v
                l_last = NOWHERE
                l_early = NOWHERE
                l_earlier = NOWHERE
                l_next = NOWHERE
            start_before = start
            start = now
            k += 1
        if loaded:
            hot.side = 1 - hot.side
            colds[hot.side, index] = cold
        after[index] = hot

    @wp.kernel(module="unique")
    def sense_rows(
        # in
        sensor: Sensor,
        begin: wp.array(dtype=wp.int32),
        episodes: wp.array2d(dtype=wp.int32),
        luminance: wp.array(dtype=wp.float32),
        dlog_dt: wp.array(dtype=wp.float32),
        frames: wp.int32,
        count: wp.int32,
        t: wp.array(dtype=wp.int64),
        t_base: wp.int64,
        t_before: wp.int64,
        thresholds_on: wp.array(dtype=wp.float32),
        thresholds_off: wp.array(dtype=wp.float32),
        leaks: wp.array(dtype=wp.float32),
        hots: wp.array(dtype=wp.float32),
        before: wp.array(dtype=Hot),
        # out
        after: wp.array(dtype=Hot),
        colds: wp.array2d(dtype=Cold),
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        """One row per thread: on a CPU, where threads run one after the other, events come in the order of pixels."""
        env, y = wp.tid()
        x = int(0)
        while x < sensor.width:
            c = int(0)
            while c < sensor.channels:
                sense(
                    sensor, env, y, x, c, begin[env], episodes, luminance, dlog_dt, frames, count, t, t_base, t_before,
                    thresholds_on, thresholds_off, leaks, hots, before, after, colds, keys, counters,
                )  # fmt: skip
                c += 1
            x += 1

    @wp.kernel(module="unique")
    def sense_pixels(
        # in
        sensor: Sensor,
        begin: wp.array(dtype=wp.int32),
        episodes: wp.array2d(dtype=wp.int32),
        luminance: wp.array(dtype=wp.float32),
        dlog_dt: wp.array(dtype=wp.float32),
        frames: wp.int32,
        count: wp.int32,
        t: wp.array(dtype=wp.int64),
        t_base: wp.int64,
        t_before: wp.int64,
        thresholds_on: wp.array(dtype=wp.float32),
        thresholds_off: wp.array(dtype=wp.float32),
        leaks: wp.array(dtype=wp.float32),
        hots: wp.array(dtype=wp.float32),
        before: wp.array(dtype=Hot),
        # out
        after: wp.array(dtype=Hot),
        colds: wp.array2d(dtype=Cold),
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        """One pixel and channel per thread, for a GPU; keys come out in any order and are sorted afterwards."""
        env, y, column = wp.tid()
        x = column // sensor.channels
        c = column % sensor.channels
        sense(
            sensor, env, y, x, c, begin[env], episodes, luminance, dlog_dt, frames, count, t, t_base, t_before,
            thresholds_on, thresholds_off, leaks, hots, before, after, colds, keys, counters,
        )  # fmt: skip

    return sense_rows, sense_pixels
