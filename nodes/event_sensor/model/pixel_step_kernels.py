# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""What happens to a pixel within a step, in the order of time; only what is asked for is compiled.

Inside a step a pixel goes from one happening to the next: a crossing, a candidate of its noise process, the end
of its dead time, the end of the step. Leak moves the signal here, S(t) = L(t) + rate C_on (t - origin), and not the
reference, so that crossings stay roots of the same polynomial. A noise event resets the pixel: its reference becomes S.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from nodes.event_sensor.model.crossing_kernels import turning_points
from nodes.event_sensor.model.emission_kernels import crossings_fired, curve_value, emit
from nodes.event_sensor.model.features import Features
from nodes.event_sensor.model.key_kernels import key_head, key_tail, key_time
from nodes.event_sensor.model.noise_kernels import candidate_after, noise_candidate, stream_here
from nodes.event_sensor.model.random_kernels import NEVER
from nodes.event_sensor.model.sensor_kernels import TOLERANCE, Sensor
from nodes.event_sensor.model.state_kernels import ALIVE
from nodes.event_sensor.model.threshold_kernels import first_crossed, reference_level, thresholds_crossed

wp.set_module_options({"enable_backward": False})


@lru_cache
def pixel_step(features: Features, at_once: Any = None) -> Any:
    """Makes the function of a pixel's events of a step, and of its state after it. at_once: see crossings_fired."""
    frame, curved, spontaneous = features.crossing == "frame", features.curved, features.noise or features.coin
    coin, noise, refractory, cap = features.coin, features.noise, features.refractory, features.cap
    crossed: Any = first_crossed
    if not refractory:

        @wp.func
        def crossed(delta: wp.float64, c_on: wp.float64, c_off: wp.float64):
            return thresholds_crossed(delta, c_on, c_off, TOLERANCE)

    value, fire = curve_value(features), crossings_fired(features, at_once)

    @wp.func
    def step(
        # in
        sensor: Sensor,
        env: wp.int32,
        inner: wp.int32,
        episodes: wp.array2d(dtype=wp.int32),
        k: wp.int32,
        y: wp.int32,
        x: wp.int32,
        c: wp.int32,
        s: wp.vec4d,
        l1: wp.float64,
        h: wp.float64,
        start: wp.int64,
        now: wp.int64,
        t_base: wp.int64,
        last: wp.float32,
        v: wp.float32,
        c_on: wp.float64,
        c_off: wp.float64,
        drift: wp.float64,
        origin: wp.int64,
        rate: wp.float64,
        hot_share: wp.float64,
        coin_at: wp.int64,
        # in and out
        base: wp.float64,
        net: wp.int32,
        n_off: wp.int32,
        dead: wp.int64,
        candidate: wp.int64,
        draws: wp.int64,
        # out
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        """Takes a pixel through a step, from one happening to the next.

        s: the curve of S over u in [0, 1] from `start` to `now`, h [ns] apart; last, v: the light at both ends.

        drift: of S [1/ns], from `origin` on. rate, hot_share: of the noise. coin_at: when a leak's coin falls in this
        step. Returns base, net, n_off, dead, candidate and draws after the step.
        """
        zero = wp.float64(0.0)
        one = wp.float64(1.0)
        per_h = one / h
        stream = wp.uint64(0)
        named = bool(False)  # the stream is known
        turns = wp.vec2d(wp.float64(2.0), wp.float64(2.0))
        if wp.static(curved):
            turns = turning_points(s)
        reference = reference_level(base, net, n_off, c_on, c_off)
        head = key_head(sensor, env)
        tail_on = key_tail(sensor, y, x, c, True)
        tail_off = key_tail(sensor, y, x, c, False)
        u = zero
        here = start
        fired = int(0)
        going = bool(True)
        while going:
            if wp.static(refractory):
                if dead != ALIVE:
                    if dead > now:
                        break
                    # Released: the pixel was held in reset, so its reference is what it sees now.
                    here = wp.max(dead, start)
                    dead = ALIVE
                    u = wp.float64(here - start) * per_h
                    base = value(s, u)
                    if wp.static(frame):
                        if here == now:
                            base = l1 + drift * wp.float64(now - origin)
                    net = 0
                    n_off = 0
                    reference = base
                    if wp.static(noise):
                        if candidate <= here:
                            stream = stream_here(sensor, env, inner, episodes, k)
                            named = True
                            candidate, draws = candidate_after(here, stream, candidate, draws, rate)
                    if wp.static(coin):
                        if coin_at <= here:
                            coin_at = NEVER
            until = now
            by_noise = bool(False)
            if wp.static(spontaneous):
                soonest = wp.min(candidate, coin_at)
                if soonest <= now:
                    until = soonest
                    by_noise = True
            u_end = one
            if by_noise:
                u_end = wp.float64(until - start) * per_h
            died = bool(False)
            while u < u_end and not died:
                piece = u_end
                if wp.static(curved):
                    if turns[1] > u and turns[1] < piece:
                        piece = turns[1]
                    if turns[0] > u and turns[0] < piece:
                        piece = turns[0]
                delta = value(s, piece) - reference
                on = delta > zero
                n, signed = crossed(delta, c_on, c_off)
                if n > 0:
                    tail = wp.where(on, tail_on, tail_off)
                    here, fired = fire(
                        sensor, s, reference, signed, n, u, piece, start, until, h, t_base, head | tail,
                        here, fired, keys, counters,
                    )  # fmt: skip
                    net = net + wp.where(on, n, -n)
                    n_off = n_off + wp.where(on, 0, n)
                    reference = reference + wp.float64(n) * signed
                    if wp.static(refractory):
                        dead = here + sensor.dead_ns
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
                                stream = stream_here(sensor, env, inner, episodes, k)
                                named = True
                            light = wp.float64(last)
                            if wp.static(not frame):
                                light += u * (wp.float64(v) - light)
                            fires, on, wait = noise_candidate(sensor, stream, draws, rate, hot_share, light)
                            draws = draws + wp.int64(1)
                            candidate = until + wait
                        if fires:
                            key = head | key_time(sensor, until - t_base)
                            key = key | wp.where(on, tail_on, tail_off)
                            emit(sensor, key, fired, wp.static(cap), keys, counters)
                            fired += 1
                            base = value(s, u)
                            if wp.static(frame):
                                if until == now:
                                    base = l1 + drift * wp.float64(now - origin)
                            net = 0
                            n_off = 0
                            reference = base
                            if wp.static(refractory):
                                dead = until + sensor.dead_ns
        if wp.static(frame):
            # The signal jumps at the frame's stamp.
            if dead <= now:
                delta = l1 + drift * wp.float64(now - origin) - reference
                on = delta > zero
                n, signed = crossed(delta, c_on, c_off)
                place = head | wp.where(on, tail_on, tail_off)
                here, fired = fire(
                    sensor, wp.vec4d(l1, zero, zero, zero), reference, signed, n, one, one, start, now, h,
                    t_base, place, now, fired, keys, counters,
                )  # fmt: skip
                net = net + wp.where(on, n, -n)
                n_off = n_off + wp.where(on, 0, n)
                if wp.static(refractory):
                    if n > 0:
                        dead = now + sensor.dead_ns
        return base, net, n_off, dead, candidate, draws

    return step
