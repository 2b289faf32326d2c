"""Advances a pixel through a step, event by event in the order of time; only the faults asked for are compiled.

Inside a step a pixel goes from one happening to the next: a crossing, a candidate of its noise process, the end
of its dead time, the end of the step. Leak moves the signal here, S(t) = L(t) + rate C_on (t - origin), and not the
reference, so that crossings stay roots of the same polynomial. A noise event resets the pixel: its reference becomes S.

The functions are inlined, and a branch sets fields of a struct and never the struct: what they hand to each other then
stays in registers. A function whose work hangs on a condition therefore holds the condition.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from nodes.event_sensor.model.crossing_kernels import turning_points
from nodes.event_sensor.model.emission_kernels import crossings_fired, curve_value, emit
from nodes.event_sensor.model.faults.noise_kernels import candidate_after, noise_candidate, stream_here
from nodes.event_sensor.model.faults.random_kernels import NEVER
from nodes.event_sensor.model.faults.refractory_kernels import dead_beyond, dead_until
from nodes.event_sensor.model.features import Features
from nodes.event_sensor.model.key_kernels import key_head, key_tail, key_time, with_mark
from nodes.event_sensor.model.sensor_kernels import TOLERANCE, Sensor
from nodes.event_sensor.model.state_kernels import ALIVE, Rare
from nodes.event_sensor.model.step_kernels import Message, Own, Place, Signal, Step, Walk
from nodes.event_sensor.model.threshold_kernels import first_crossed, reference_level, thresholds_crossed

wp.set_module_options({"enable_backward": False})


@wp.func(inline=True)
def step_begun(
    sensor: Sensor, place: Place, step: Step, coin_at: wp.int64, own: Own, state: Rare, nothing: wp.int32
):  # fmt: skip
    """Makes the Walk of a pixel that stands at a step's start."""
    walk = Walk()
    walk.u = wp.float64(0.0)
    walk.here = step.start
    walk.reference = reference_level(state.base, state.net, state.n_off, own.c_on, own.c_off)
    walk.fired = nothing
    walk.coin_at = coin_at
    walk.stream = wp.uint64(0)
    walk.named = False
    head = key_head(sensor, place.env)
    walk.key_on = head | key_tail(sensor, place.y, place.x, place.c, True)
    walk.key_off = head | key_tail(sensor, place.y, place.x, place.c, False)
    return walk


@lru_cache
def crossing_key(features: Features) -> Any:
    """Makes the function of the key, but for its time, of a crossing of the signal."""

    @wp.func(inline=True)
    def key_of(walk: Walk, step: Step, signal: Signal, own: Own, origin: wp.int64, on: wp.bool):
        """Returns the key; where events are marked, an ON crossing is noise if leak moves S further in this step
        than light does. origin: where the leak's drift is zero [ns]."""
        key = wp.where(on, walk.key_on, walk.key_off)
        if wp.static(features.marked):
            leaked = own.drift * step.h
            rise = signal.l1 - signal.s[0] + own.drift * wp.float64(step.start - origin)
            key = with_mark(key, on and wp.abs(rise) < leaked)
        return key

    return key_of


@lru_cache
def threshold_count(features: Features) -> Any:
    """Makes the function of how many thresholds are crossed: one at most where a dead time follows."""
    if features.refractory:
        return first_crossed

    @wp.func
    def crossed(delta: wp.float64, c_on: wp.float64, c_off: wp.float64):
        """Computes n of equation (4) and the threshold with its sign."""
        return thresholds_crossed(delta, c_on, c_off, TOLERANCE)

    return crossed


@lru_cache
def level_seen(features: Features) -> Any:
    """Makes the function of S where a pixel is reset."""
    frame, value = features.crossing == "frame", curve_value(features)

    @wp.func(inline=True)
    def level_at(step: Step, signal: Signal, own: Own, state: Rare, u: wp.float64, when: wp.int64):
        """Computes S at place u, time `when`, of a step; of frames it jumps at the step's end."""
        level = value(signal.s, u)
        if wp.static(frame):
            if when == step.now:
                level = signal.l1 + own.drift * wp.float64(step.now - state.origin)
        return level

    return level_at


@lru_cache
def dead_time_end(features: Features) -> Any:
    """Makes the function of what happens where a dead time ends."""
    coin, noise, level_at = features.coin, features.noise, level_seen(features)

    @wp.func(inline=True)
    def release(
        # in
        sensor: Sensor,
        place: Place,
        message: Message,
        step: Step,
        signal: Signal,
        own: Own,
        # in and out
        state: Rare,
        walk: Walk,
    ):
        """Lets a pixel go whose dead time has ended: it was held in reset, so its reference is what it sees now."""
        if state.dead != ALIVE:
            walk.here = wp.max(state.dead, step.start)
            state.dead = ALIVE
            walk.u = wp.float64(walk.here - step.start) * step.per_h
            state.base = level_at(step, signal, own, state, walk.u, walk.here)
            state.net = 0
            state.n_off = 0
            walk.reference = state.base
            if wp.static(noise):
                if state.next <= walk.here:
                    walk.stream = stream_here(sensor, place.env, place.inner, message.episodes, step.k)
                    walk.named = True
                    candidate, draws = candidate_after(walk.here, walk.stream, state.next, state.draws, own.rate)
                    state.next = candidate
                    state.draws = draws
            if wp.static(coin):
                if walk.coin_at <= walk.here:
                    walk.coin_at = NEVER
        return state, walk

    return release


@lru_cache
def noise_event(features: Features) -> Any:
    """Makes the function of what happens at a candidate of the noise or where a leak's coin falls."""
    frame, refractory, cap = features.crossing == "frame", features.refractory, features.cap
    marked = features.marked
    level_at = level_seen(features)

    @wp.func(inline=True)
    def fire_by_noise(
        # in
        sensor: Sensor,
        place: Place,
        message: Message,
        step: Step,
        signal: Signal,
        own: Own,
        due: wp.bool,
        when: wp.int64,
        u: wp.float64,
        # in and out
        state: Rare,
        walk: Walk,
        # out
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        """Takes a pixel to a candidate at time `when`, place u, if one is `due`; firing resets the pixel."""
        if due:
            walk.here = when
            walk.u = u
            fires = bool(True)
            on = bool(True)
            if when == walk.coin_at:
                walk.coin_at = NEVER
            else:
                if not walk.named:
                    walk.stream = stream_here(sensor, place.env, place.inner, message.episodes, step.k)
                    walk.named = True
                light = wp.float64(signal.last)
                if wp.static(not frame):
                    light += u * (wp.float64(signal.light) - light)
                fires, on, wait = noise_candidate(sensor, walk.stream, state.draws, own.rate, own.hot_share, light)
                state.draws = state.draws + wp.int64(1)
                state.next = when + wait
            if fires:
                key = wp.where(on, walk.key_on, walk.key_off)
                if wp.static(marked):
                    key = with_mark(key, True)
                key = key_time(sensor, when - message.t_base) | key
                emit(sensor, key, walk.fired, wp.static(cap), keys, counters)
                walk.fired = walk.fired + 1
                state.base = level_at(step, signal, own, state, u, when)
                state.net = 0
                state.n_off = 0
                walk.reference = state.base
                if wp.static(refractory):
                    state.dead = dead_until(sensor, when)
        return state, walk

    return fire_by_noise


@lru_cache
def signal_crossings(features: Features, at_once: Any = None) -> Any:
    """Makes the function of the crossings of the signal up to the next happening."""
    curved, refractory = features.curved, features.refractory
    value, crossed, fire = curve_value(features), threshold_count(features), crossings_fired(features, at_once)
    key_of = crossing_key(features)

    @wp.func(inline=True)
    def cross(
        # in
        sensor: Sensor,
        t_base: wp.int64,
        step: Step,
        signal: Signal,
        own: Own,
        turns: wp.vec2d,
        until: wp.int64,
        u_end: wp.float64,
        # in and out
        state: Rare,
        walk: Walk,
        # out
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        """Fires the crossings up to time `until`, place u_end; returns True where a dead time begins before.

        turns: where the curve turns; it is monotone between them.
        """
        died = bool(False)
        while walk.u < u_end and not died:
            piece = wp.float64(u_end)
            if wp.static(curved):
                if turns[1] > walk.u and turns[1] < piece:
                    piece = turns[1]
                if turns[0] > walk.u and turns[0] < piece:
                    piece = turns[0]
            delta = value(signal.s, piece) - walk.reference
            on = delta > wp.float64(0.0)
            n, signed = crossed(delta, own.c_on, own.c_off)
            if n > 0:
                key = key_of(walk, step, signal, own, state.origin, on)
                last = fire(
                    sensor, t_base, step, signal.s, walk, signed, n, piece, until, key, keys, counters
                )  # fmt: skip
                walk.here = last
                walk.fired = walk.fired + n
                state.net = state.net + wp.where(on, n, -n)
                state.n_off = state.n_off + wp.where(on, 0, n)
                walk.reference = walk.reference + wp.float64(n) * signed
                if wp.static(refractory):
                    state.dead = dead_until(sensor, last)
                    died = True
            walk.u = piece
        return died, state, walk

    return cross


@lru_cache
def jump_at_stamp(features: Features, at_once: Any = None) -> Any:
    """Makes the function of the jump of the signal at a frame's stamp, of crossing=frame."""
    refractory, crossed, fire = features.refractory, threshold_count(features), crossings_fired(features, at_once)
    key_of = crossing_key(features)

    @wp.func(inline=True)
    def jump(
        # in
        sensor: Sensor,
        t_base: wp.int64,
        step: Step,
        signal: Signal,
        own: Own,
        # in and out
        state: Rare,
        walk: Walk,
        # out
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        """Fires the crossings of a jump to the level of the frame at the step's end, unless the pixel is dead then."""
        if not dead_beyond(state.dead, step.now):
            zero = wp.float64(0.0)
            delta = signal.l1 + own.drift * wp.float64(step.now - state.origin) - walk.reference
            on = delta > zero
            n, signed = crossed(delta, own.c_on, own.c_off)
            walk.u = wp.float64(1.0)
            walk.here = step.now
            level = wp.vec4d(signal.l1, zero, zero, zero)
            key = key_of(walk, step, signal, own, state.origin, on)
            fire(sensor, t_base, step, level, walk, signed, n, walk.u, step.now, key, keys, counters)
            state.net = state.net + wp.where(on, n, -n)
            state.n_off = state.n_off + wp.where(on, 0, n)
            if wp.static(refractory):
                if n > 0:
                    state.dead = dead_until(sensor, step.now)
        return state

    return jump


@lru_cache
def pixel_step(features: Features, at_once: Any = None) -> Any:
    """Makes the function of a pixel's events of a step, and of its state after it. at_once: see crossings_fired."""
    frame, curved, spontaneous = features.crossing == "frame", features.curved, features.noise or features.coin
    refractory = features.refractory
    release, fire_by_noise = dead_time_end(features), noise_event(features)
    cross, jump = signal_crossings(features, at_once), jump_at_stamp(features, at_once)

    @wp.func(inline=True)
    def take_step(
        # in
        sensor: Sensor,
        place: Place,
        message: Message,
        step: Step,
        signal: Signal,
        own: Own,
        coin_at: wp.int64,
        # in and out
        state: Rare,
        # out
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        """Takes a pixel through a step, from one happening to the next; returns its state after the step.

        coin_at: when a leak's coin falls in this step, or NEVER.
        """
        turns = wp.vec2d(wp.float64(2.0), wp.float64(2.0))
        if wp.static(curved):
            turns = turning_points(signal.s)
        walk = step_begun(sensor, place, step, coin_at, own, state, 0)
        going = bool(True)
        while going:
            if wp.static(refractory):
                if dead_beyond(state.dead, step.now):
                    break
                state, walk = release(sensor, place, message, step, signal, own, state, walk)
            until = wp.int64(step.now)
            u_end = wp.float64(1.0)
            by_noise = bool(False)
            if wp.static(spontaneous):
                soonest = wp.min(state.next, walk.coin_at)
                if soonest <= step.now:
                    until = soonest
                    u_end = wp.float64(until - step.start) * step.per_h
                    by_noise = True
            died, state, walk = cross(
                sensor, message.t_base, step, signal, own, turns, until, u_end, state, walk, keys, counters
            )
            going = died or by_noise
            if wp.static(spontaneous):
                due = by_noise and not died
                state, walk = fire_by_noise(
                    sensor, place, message, step, signal, own, due, until, u_end, state, walk, keys, counters
                )
        if wp.static(frame):
            state = jump(sensor, message.t_base, step, signal, own, state, walk, keys, counters)
        return state

    return take_step
