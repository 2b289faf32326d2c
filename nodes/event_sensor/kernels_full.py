# ruff: noqa: RUF046, UP018 - int(0) is how a Warp kernel declares a variable that changes
"""The sensor with curves between frames and with faults, in the order of time; only what is asked for is compiled.

A pixel's life inside a step goes from one happening to the next: a crossing, a candidate of its noise process, the end
of its dead time, the end of the step. Leak is a drift of the reference, here of the signal instead, S(t) = L(t) +
rate C_on (t - origin), against a reference that stands still, so that crossings stay roots of the same polynomial. A
noise event resets the pixel as any event does: the reference becomes S at its time.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from nodes.event_sensor import kernels_step as pieces
from nodes.event_sensor.kernels import (
    EVENTS,
    LARGEST,
    NONFINITE,
    TOLERANCE,
    Sensor,
    count_clipped,
    key_head,
    key_tail,
    log_level,
    valid,
)
from nodes.event_sensor.kernels_curve import at, crossing, turning_points
from nodes.event_sensor.kernels_noise import NEVER, draw, waiting_time
from nodes.event_sensor.kernels_quiet import Quiet
from nodes.event_sensor.kernels_state import ALIVE, NOWHERE, Cold, Features, Warm, emit, unknown_levels

wp.set_module_options({"enable_backward": False})


@lru_cache
def sense_pixel(features: Features) -> Any:
    """Function: all steps of one pixel in a message. It writes the events as keys, and counts."""
    frame, hermite = features.crossing == "frame", features.crossing == "hermite"
    ahead, curved, timed, hasty = features.ahead, features.curved, features.timed, features.hasty
    leak, coin, noise = features.leak, features.coin, features.noise
    refractory, mismatch, cap = features.refractory, features.mismatch, features.cap
    spontaneous = noise or coin
    curve, curve_quiet, rest = pieces.step_curve(features), pieces.surely_quiet(features), pieces.band_left(features)

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
        before: Quiet,
        warm_before: wp.array(dtype=Warm),
        # out
        after: Quiet,
        warm_after: wp.array(dtype=Warm),
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
        two_sided = colds.shape[0] == 2
        warm = Warm()
        if wp.static(curved) or two_sided:
            warm = warm_before[index]
        hot = pieces.take(before, warm, index)
        start = t_base
        start_before = t_before
        k = int(0)
        if wp.static(hasty):
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
                    pieces.put(after, index, hot)
                    if two_sided:
                        warm_after[index] = warm
                    return
                if k > 0:
                    start = t[k - 1]
        cold = Cold()
        loaded = bool(False)
        c_on = sensor.threshold_on
        c_off = sensor.threshold_off
        drift = zero  # of S [1/ns]
        rate = sensor.shot_rate
        hot_share = zero
        stream = wp.uint64(0)
        named = bool(False)  # the stream is known
        levels = unknown_levels(NOWHERE)
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
                slope = pieces.slope_of(sensor, dlog_dt[first + wp.int64(k) * stride], v)
            quiet = v >= hot.low and v <= hot.high
            if wp.static(timed):
                quiet = quiet and now < hot.wake
            if wp.static(curved):
                quiet = quiet and curve_quiet(sensor, hot, v, slope, following, now - start)
            coin_at = NEVER
            if wp.static(coin):
                if not begins and hot.low <= LARGEST:
                    if not named:
                        stream = pieces.stream_here(sensor, env, inner, episodes, k)
                        named = True
                    coin_at = pieces.coin_time(stream, colds[warm.side, index].leak, start, now)
                    quiet = quiet and coin_at == NEVER
            if not quiet:
                held = not valid(sensor, v)
                if held:
                    wp.atomic_add(counters, NONFINITE, wp.int64(1))
                if not loaded:
                    cold = colds[warm.side, index]
                    loaded = True
                    if wp.static(mismatch):
                        c_on = wp.float64(cold.c_on)
                        c_off = wp.float64(cold.c_off)
                    if wp.static(leak):
                        drift = wp.float64(cold.leak) * c_on * wp.float64(1.0e-9)
                    if wp.static(noise):
                        rate = rate + wp.float64(cold.hot)
                        hot_share = wp.float64(cold.hot) / wp.max(rate, wp.float64(1.0e-300))
                if hot.low > LARGEST:
                    if not held:
                        count_clipped(sensor, v, counters)
                        candidate = NEVER
                        if wp.static(noise):
                            stream = pieces.stream_here(sensor, env, inner, episodes, k)
                            named = True
                            if rate > zero:
                                candidate = now + waiting_time(draw(stream, wp.int64(0)), rate)
                        cold = pieces.first_reference(sensor, cold, v, now, candidate)
                        levels = unknown_levels(cold.base)
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
                    # The curve S(u), u in [0, 1].
                    if levels.last == NOWHERE:
                        levels.last = log_level(sensor, hot.last)
                    l1 = levels.next
                    if l1 == NOWHERE:
                        l1 = log_level(sensor, v)
                    s = wp.vec4d(levels.last, wp.where(wp.static(frame), zero, l1 - levels.last), zero, zero)
                    if wp.static(curved):
                        h_before = wp.float64(start - start_before)
                        h_after = one
                        if has_next:
                            h_after = wp.float64(t[k + 1] - now)
                        s, levels = curve(
                            sensor, hot, levels, l1, slope, following, has_next, h, h_before, h_after, counters
                        )
                    s[0] = s[0] + drift * wp.float64(start - cold.origin)
                    if wp.static(leak):
                        s[1] = s[1] + drift * h
                    turns = wp.vec2d(wp.float64(2.0), wp.float64(2.0))
                    if wp.static(curved):
                        turns = turning_points(s)
                    # -- the happenings ---------------------------------------------------------------------------
                    reference = pieces.reference_of(cold.base, cold.net, cold.n_off, c_on, c_off)
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
                                            stream = pieces.stream_here(sensor, env, inner, episodes, k)
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
                                            stream = pieces.stream_here(sensor, env, inner, episodes, k)
                                            named = True
                                        light = wp.float64(hot.last)
                                        if wp.static(not frame):
                                            light += u * (wp.float64(v) - light)
                                        fires, on, wait = pieces.noise_candidate(
                                            sensor, stream, cold.draws, rate, hot_share, light
                                        )
                                        cold.draws = cold.draws + wp.int64(1)
                                        cold.next = until + wait
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
                        levels.earlier = levels.early
                        levels.early = levels.last
                    if wp.static(hermite):
                        hot.earlier = hot.early
                        hot.early = slope
                    hot.last = v
                    levels.last = l1
                # -- the band in which nothing can happen before hot.wake -----------------------------------------
                if hot.low <= LARGEST:
                    reference = pieces.reference_of(cold.base, cold.net, cold.n_off, c_on, c_off)
                    reference = reference - drift * wp.float64(now - cold.origin)
                    low, high, wake = rest(
                        sensor, reference, c_on, c_off, drift, now, levels.last, cold.next, cold.dead
                    )
                    hot.low = low
                    hot.high = high
                    hot.wake = wake
            else:
                if wp.static(curved):
                    hot.earlier = hot.early
                    hot.early = wp.where(wp.static(hermite), slope, hot.last)
                hot.last = v
                levels = unknown_levels(NOWHERE)
            start_before = start
            start = now
            k += 1
        if counters[EVENTS] <= sensor.capacity:
            if loaded:
                if two_sided:
                    warm.side = 1 - warm.side
                colds[warm.side, index] = cold
            pieces.put(after, index, hot)
            if wp.static(curved):
                warm.early = hot.early
                warm.earlier = hot.earlier
            if wp.static(curved) or two_sided:
                warm_after[index] = warm

    return sense
