# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""The sensor with curves between frames and with faults, in the order of time; only what is asked for is compiled.

Here a pixel is taken from frame to frame: whether something may happen to it in a step, the curve of the step, the
range it is left with. What happens within the step is in nodes.event_sensor.model.pixel_step_kernels.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from nodes.event_sensor.model.curve_kernels import slope_of, step_curve
from nodes.event_sensor.model.features import Features
from nodes.event_sensor.model.inactive_kernels import range_left, surely_inactive
from nodes.event_sensor.model.leak_kernels import coin_time, leak_origin
from nodes.event_sensor.model.noise_kernels import stream_here
from nodes.event_sensor.model.pixel_step_kernels import pixel_step
from nodes.event_sensor.model.random_kernels import NEVER, draw, waiting_time
from nodes.event_sensor.model.sensor_kernels import (
    EVENTS,
    LARGEST,
    NONFINITE,
    Sensor,
    count_clipped,
    has_level,
    log_level,
)
from nodes.event_sensor.model.state_kernels import (
    ALIVE,
    NOWHERE,
    FrequentState,
    Rare,
    rare_of,
    read_frequent,
    write_frequent,
)
from nodes.event_sensor.model.threshold_kernels import reference_level

wp.set_module_options({"enable_backward": False})


@lru_cache
def sense_pixel(features: Features, at_once: Any = None) -> Any:
    """Makes the function of all steps of one pixel in a message. at_once: see emission_kernels.crossings_fired."""
    frame, hermite = features.crossing == "frame", features.crossing == "hermite"
    ahead, curved, timed, hasty = features.ahead, features.curved, features.timed, features.hasty
    leak, coin, noise, mismatch = features.leak, features.coin, features.noise, features.mismatch
    step = pixel_step(features, at_once)
    curve, curve_inactive, rest = step_curve(features), surely_inactive(features), range_left(features)

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
        before: FrequentState,
        side_before: wp.array(dtype=wp.int32),
        # out
        after: FrequentState,
        side_after: wp.array(dtype=wp.int32),
        rare: wp.array2d(dtype=Rare),
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        """Takes a pixel through the frames of a message; writes its events as keys, and counts."""
        zero = wp.float64(0.0)
        one = wp.float64(1.0)
        size = sensor.height * sensor.width * sensor.channels
        inner = (y * sensor.width + x) * sensor.channels + c
        index = env * size + inner
        first = wp.int64(env) * wp.int64(frames) * wp.int64(size) + wp.int64(inner)
        stride = wp.int64(size)
        two_sided = rare.shape[0] == 2
        side = int(0)
        if two_sided:
            side = side_before[index]
        frequent = read_frequent(before, index)
        start = t_base
        start_before = t_before
        k = int(0)
        if wp.static(hasty):
            # Most pixels are inactive through the whole message: the short way.
            if begin == 0:
                last = frequent.last
                while k < count:
                    sample = luminance[first + wp.int64(k) * stride]
                    if not (sample >= frequent.low and sample <= frequent.high):
                        break
                    if wp.static(timed):
                        if t[k] >= frequent.wake:
                            break
                    last = sample
                    k += 1
                frequent.last = last
                if k == count:
                    write_frequent(after, index, frequent)
                    if two_sided:
                        side_after[index] = side
                    return
                if k > 0:
                    start = t[k - 1]
        # Field by field: a struct that is set in a branch would go through memory.
        loaded = bool(False)
        base = wp.float64(0.0)
        net = wp.int32(0)
        n_off = wp.int32(0)
        origin = wp.int64(0)
        dead = wp.int64(0)
        candidate = wp.int64(0)
        draws = wp.int64(0)
        own_on = wp.float32(0.0)
        own_off = wp.float32(0.0)
        own_leak = wp.float32(0.0)
        own_hot = wp.float32(0.0)
        c_on = sensor.threshold_on
        c_off = sensor.threshold_off
        drift = wp.float64(0.0)  # of S [1/ns]
        rate = sensor.shot_rate
        hot_share = wp.float64(0.0)
        stream = wp.uint64(0)
        named = bool(False)  # the stream is known
        # L of the samples earlier, early, last and next, where known.
        l_earlier = NOWHERE + zero
        l_early = NOWHERE + zero
        l_last = NOWHERE + zero
        l_next = NOWHERE + zero
        moved = wp.float64(0.0)
        while k < count:
            v = luminance[first + wp.int64(k) * stride]
            now = t[k]
            begins = k < 2 and ((begin >> k) & 1) != 0
            if begins:
                frequent.low = float(wp.inf)
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
            inactive = v >= frequent.low and v <= frequent.high
            if wp.static(timed):
                inactive = inactive and now < frequent.wake
            if wp.static(curved):
                inactive = inactive and curve_inactive(sensor, frequent, v, slope, following, now - start)
            coin_at = NEVER
            if wp.static(coin):
                if not begins and frequent.low <= LARGEST:
                    if not named:
                        stream = stream_here(sensor, env, inner, episodes, k)
                        named = True
                    coin_at = coin_time(stream, rare[side, index].leak, start, now)
                    inactive = inactive and coin_at == NEVER
            if not inactive:
                held = not has_level(sensor, v)
                if held:
                    wp.atomic_add(counters, NONFINITE, wp.int64(1))
                if not loaded:
                    loaded = True
                    base = rare[side, index].base
                    net = rare[side, index].net
                    n_off = rare[side, index].n_off
                    origin = rare[side, index].origin
                    dead = rare[side, index].dead
                    candidate = rare[side, index].next
                    draws = rare[side, index].draws
                    own_on = rare[side, index].c_on
                    own_off = rare[side, index].c_off
                    own_leak = rare[side, index].leak
                    own_hot = rare[side, index].hot
                    if wp.static(mismatch):
                        c_on = wp.float64(own_on)
                        c_off = wp.float64(own_off)
                    if wp.static(leak):
                        drift = wp.float64(own_leak) * c_on * wp.float64(1.0e-9)
                    if wp.static(noise):
                        rate = rate + wp.float64(own_hot)
                        hot_share = wp.float64(own_hot) / wp.max(rate, wp.float64(1.0e-300))
                if frequent.low > LARGEST:
                    if not held:
                        count_clipped(sensor, v, counters)
                        base = log_level(sensor, v)
                        net = 0
                        n_off = 0
                        origin = now
                        dead = ALIVE
                        candidate = NEVER
                        draws = wp.int64(0)
                        if wp.static(leak or noise):
                            stream = stream_here(sensor, env, inner, episodes, k)
                            named = True
                        if wp.static(leak):
                            origin = leak_origin(stream, own_leak, now)
                        if wp.static(noise):
                            if rate > zero:
                                candidate = now + waiting_time(draw(stream, wp.int64(0)), rate)
                        l_earlier = NOWHERE
                        l_early = NOWHERE
                        l_last = base
                        l_next = NOWHERE
                        frequent.last = v
                        frequent.low = 0.0
                        if wp.static(ahead):
                            frequent.early = -1.0
                            frequent.earlier = -1.0
                        if wp.static(hermite):
                            frequent.early = slope
                            frequent.earlier = float(wp.nan)
                else:
                    if held:
                        v = frequent.last
                        slope = 0.0
                    count_clipped(sensor, v, counters)
                    h = wp.float64(now - start)
                    # The curve S(u), u in [0, 1].
                    if l_last == NOWHERE:
                        l_last = log_level(sensor, frequent.last)
                    l1 = l_next
                    if l1 == NOWHERE:
                        l1 = log_level(sensor, v)
                    s = wp.vec4d(l_last, wp.where(wp.static(frame), zero, l1 - l_last), zero, zero)
                    if wp.static(curved):
                        h_before = wp.float64(start - start_before)
                        h_after = one
                        if has_next:
                            h_after = wp.float64(t[k + 1] - now)
                        s, l_earlier, l_early, l_next = curve(
                            sensor, frequent, l_earlier, l_early, l_last, l1, slope, following, has_next, h, h_before,
                            h_after, counters,
                        )  # fmt: skip
                    s[0] = s[0] + drift * wp.float64(start - origin)
                    if wp.static(leak):
                        s[1] = s[1] + drift * h
                    base, net, n_off, dead, candidate, draws = step(
                        sensor, env, inner, episodes, k, y, x, c, s, l1, h, start, now, t_base, frequent.last, v,
                        c_on, c_off, drift, origin, rate, hot_share, coin_at,
                        base, net, n_off, dead, candidate, draws, keys, counters,
                    )  # fmt: skip
                    if wp.static(ahead):
                        frequent.earlier = frequent.early
                        frequent.early = frequent.last
                        l_earlier = l_early
                        l_early = l_last
                    if wp.static(hermite):
                        frequent.earlier = frequent.early
                        frequent.early = slope
                    frequent.last = v
                    moved = wp.abs(l1 - l_last)
                    l_last = l1
                # -- the range in which nothing can happen before frequent.wake ----------------------------------------
                if frequent.low <= LARGEST:
                    reference = reference_level(base, net, n_off, c_on, c_off)
                    reference = reference - drift * wp.float64(now - origin)
                    low, high, wake = rest(
                        sensor, reference, c_on, c_off, drift, now, now - start, l_last, moved, candidate, dead
                    )
                    frequent.low = low
                    frequent.high = high
                    frequent.wake = wake
            else:
                if wp.static(curved):
                    frequent.earlier = frequent.early
                    frequent.early = wp.where(wp.static(hermite), slope, frequent.last)
                frequent.last = v
                l_earlier = NOWHERE
                l_early = NOWHERE
                l_last = NOWHERE
                l_next = NOWHERE
            start_before = start
            start = now
            k += 1
        if counters[EVENTS] <= sensor.capacity:
            if loaded:
                if two_sided:
                    side = 1 - side
                rare[side, index] = rare_of(
                    base, net, n_off, origin, dead, candidate, draws, own_on, own_off, own_leak, own_hot
                )
            write_frequent(after, index, frequent)
            if two_sided:
                side_after[index] = side

    return sense
