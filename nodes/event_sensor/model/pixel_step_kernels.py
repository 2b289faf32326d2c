"""Advances a pixel through a step, event by event in the order of time; only the faults asked for are compiled.

Inside a step a pixel goes from one happening to the next: a crossing, a candidate of its noise process, the end of its
refractory period, the end of the step. Leak moves the signal here, S(t) = L(t) + rate C_on (t - origin), and not the
reference, so that crossings stay roots of the same polynomial. A noise event resets the pixel: its reference becomes S.

The functions are inlined, and a branch sets fields of a struct and never the struct: what they hand to each other then
stays in registers. A function whose work hangs on a condition therefore holds the condition.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from nodes.event_sensor.model.crossing_kernels import turning_points
from nodes.event_sensor.model.emission_kernels import emit, make_curve_value, make_emit_crossings
from nodes.event_sensor.model.faults.noise_kernels import candidate_after, noise_candidate, stream_here
from nodes.event_sensor.model.faults.random_kernels import NEVER
from nodes.event_sensor.model.faults.refractory_kernels import refractory_beyond, refractory_end
from nodes.event_sensor.model.features import Features
from nodes.event_sensor.model.key_kernels import key_head, key_tail, key_time, with_mark
from nodes.event_sensor.model.sensor_kernels import TOLERANCE, Sensor
from nodes.event_sensor.model.state_kernels import NOT_REFRACTORY, Rare
from nodes.event_sensor.model.step_kernels import Message, PixelParameters, Place, Signal, Step, StepProgress
from nodes.event_sensor.model.threshold_kernels import first_crossed, reference_level, thresholds_crossed

wp.set_module_options({"enable_backward": False})


@wp.func(inline=True)
def begin_step(
    sensor: Sensor,
    place: Place,
    step: Step,
    leak_event_at: wp.int64,
    own: PixelParameters,
    state: Rare,
    nothing: wp.int32,
):
    """Makes the StepProgress of a pixel that stands at a step's start."""
    progress = StepProgress()
    progress.u = wp.float64(0.0)
    progress.last_time = step.start
    progress.reference = reference_level(state.base, state.net, state.n_off, own.c_on, own.c_off)
    progress.fired = nothing
    progress.leak_event_at = leak_event_at
    progress.stream = wp.uint64(0)
    progress.stream_known = False
    head = key_head(sensor, place.env)
    progress.key_on = head | key_tail(sensor, place.y, place.x, place.c, True)
    progress.key_off = head | key_tail(sensor, place.y, place.x, place.c, False)
    return progress


@lru_cache
def make_crossing_key(features: Features) -> Any:
    """Makes the function `crossing_key`."""

    @wp.func(inline=True)
    def crossing_key(
        progress: StepProgress, step: Step, signal: Signal, own: PixelParameters, origin: wp.int64, on: wp.bool
    ):
        """Returns the key of a crossing, but for its time.

        Where events are marked, an ON crossing is noise if leak moves S further in this step than light does. origin:
        where the leak's drift is zero [ns].
        """
        key = wp.where(on, progress.key_on, progress.key_off)
        if wp.static(features.marked):
            leaked = own.drift * step.h
            rise = signal.l1 - signal.s[0] + own.drift * wp.float64(step.start - origin)
            key = with_mark(key, on and wp.abs(rise) < leaked)
        return key

    return crossing_key


@lru_cache
def make_count_thresholds(features: Features) -> Any:
    """Makes the function `count_thresholds`: it counts one crossing at most where a refractory period follows."""
    if features.refractory:
        return first_crossed

    @wp.func
    def count_thresholds(delta: wp.float64, c_on: wp.float64, c_off: wp.float64):
        """Computes n of equation (4) and the threshold with its sign."""
        return thresholds_crossed(delta, c_on, c_off, TOLERANCE)

    return count_thresholds


@lru_cache
def make_signal_at(features: Features) -> Any:
    """Makes the function `signal_at`, S where a pixel is reset."""
    frame, curve_value = features.crossing == "frame", make_curve_value(features)

    @wp.func(inline=True)
    def signal_at(step: Step, signal: Signal, own: PixelParameters, state: Rare, u: wp.float64, when: wp.int64):
        """Computes S at place u, time `when`, of a step; of frames it jumps at the step's end."""
        level = curve_value(signal.s, u)
        if wp.static(frame):
            if when == step.now:
                level = signal.l1 + own.drift * wp.float64(step.now - state.origin)
        return level

    return signal_at


@lru_cache
def make_end_refractory(features: Features) -> Any:
    """Makes the function `end_refractory`."""
    bernoulli_leak, noise, signal_at = features.bernoulli_leak, features.noise, make_signal_at(features)

    @wp.func(inline=True)
    def end_refractory(
        # in
        sensor: Sensor,
        place: Place,
        message: Message,
        step: Step,
        signal: Signal,
        own: PixelParameters,
        # in and out
        state: Rare,
        progress: StepProgress,
    ):
        """Lets a pixel go whose refractory period has ended: it was held in reset, so its reference is what it sees
        now."""
        if state.refractory_until != NOT_REFRACTORY:
            progress.last_time = wp.max(state.refractory_until, step.start)
            state.refractory_until = NOT_REFRACTORY
            progress.u = wp.float64(progress.last_time - step.start) * step.per_h
            state.base = signal_at(step, signal, own, state, progress.u, progress.last_time)
            state.net = 0
            state.n_off = 0
            progress.reference = state.base
            if wp.static(noise):
                if state.next_noise <= progress.last_time:
                    progress.stream = stream_here(sensor, place.env, place.inner, message.episodes, step.k)
                    progress.stream_known = True
                    candidate, draws = candidate_after(
                        progress.last_time, progress.stream, state.next_noise, state.noise_draws, own.rate
                    )
                    state.next_noise = candidate
                    state.noise_draws = draws
            if wp.static(bernoulli_leak):
                if progress.leak_event_at <= progress.last_time:
                    progress.leak_event_at = NEVER
        return state, progress

    return end_refractory


@lru_cache
def make_fire_by_noise(features: Features) -> Any:
    """Makes the function `fire_by_noise`."""
    frame, refractory, cap = features.crossing == "frame", features.refractory, features.cap
    marked = features.marked
    signal_at = make_signal_at(features)

    @wp.func(inline=True)
    def fire_by_noise(
        # in
        sensor: Sensor,
        place: Place,
        message: Message,
        step: Step,
        signal: Signal,
        own: PixelParameters,
        due: wp.bool,
        when: wp.int64,
        u: wp.float64,
        # in and out
        state: Rare,
        progress: StepProgress,
        # out
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        """Takes a pixel to a candidate of the noise, or to its Bernoulli leak, at time `when`, place u, if one is due.

        Firing resets the pixel.
        """
        if due:
            progress.last_time = when
            progress.u = u
            fires = bool(True)
            on = bool(True)
            if when == progress.leak_event_at:
                progress.leak_event_at = NEVER
            else:
                if not progress.stream_known:
                    progress.stream = stream_here(sensor, place.env, place.inner, message.episodes, step.k)
                    progress.stream_known = True
                light = wp.float64(signal.last)
                if wp.static(not frame):
                    light += u * (wp.float64(signal.light) - light)
                fires, on, wait = noise_candidate(
                    sensor, progress.stream, state.noise_draws, own.rate, own.hot_share, light
                )
                state.noise_draws = state.noise_draws + wp.int64(1)
                state.next_noise = when + wait
            if fires:
                key = wp.where(on, progress.key_on, progress.key_off)
                if wp.static(marked):
                    key = with_mark(key, True)
                key = key_time(sensor, when - message.t_base) | key
                emit(sensor, key, progress.fired, wp.static(cap), keys, counters)
                progress.fired = progress.fired + 1
                state.base = signal_at(step, signal, own, state, u, when)
                state.net = 0
                state.n_off = 0
                progress.reference = state.base
                if wp.static(refractory):
                    state.refractory_until = refractory_end(sensor, when)
        return state, progress

    return fire_by_noise


@lru_cache
def make_fire_crossings(features: Features, at_once: Any = None) -> Any:
    """Makes the function `fire_crossings`. at_once: as of make_emit_crossings."""
    curved, refractory = features.curved, features.refractory
    curve_value, count_thresholds, emit_crossings = (
        make_curve_value(features),
        make_count_thresholds(features),
        make_emit_crossings(features, at_once),
    )
    crossing_key = make_crossing_key(features)

    @wp.func(inline=True)
    def fire_crossings(
        # in
        sensor: Sensor,
        t_base: wp.int64,
        step: Step,
        signal: Signal,
        own: PixelParameters,
        turns: wp.vec2d,
        until: wp.int64,
        u_end: wp.float64,
        # in and out
        state: Rare,
        progress: StepProgress,
        # out
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        """Fires the crossings up to time `until`, place u_end; returns True where a refractory period begins
        before.

        turns: where the curve turns; it is monotone between them.
        """
        became_refractory = bool(False)
        while progress.u < u_end and not became_refractory:
            piece = wp.float64(u_end)
            if wp.static(curved):
                if turns[1] > progress.u and turns[1] < piece:
                    piece = turns[1]
                if turns[0] > progress.u and turns[0] < piece:
                    piece = turns[0]
            delta = curve_value(signal.s, piece) - progress.reference
            on = delta > wp.float64(0.0)
            n, signed = count_thresholds(delta, own.c_on, own.c_off)
            if n > 0:
                key = crossing_key(progress, step, signal, own, state.origin, on)
                last = emit_crossings(
                    sensor, t_base, step, signal.s, progress, signed, n, piece, until, key, keys, counters
                )  # fmt: skip
                progress.last_time = last
                progress.fired = progress.fired + n
                state.net = state.net + wp.where(on, n, -n)
                state.n_off = state.n_off + wp.where(on, 0, n)
                progress.reference = progress.reference + wp.float64(n) * signed
                if wp.static(refractory):
                    state.refractory_until = refractory_end(sensor, last)
                    became_refractory = True
            progress.u = piece
        return became_refractory, state, progress

    return fire_crossings


@lru_cache
def make_fire_jump(features: Features, at_once: Any = None) -> Any:
    """Makes the function `fire_jump`, for crossing=frame. at_once: as of make_emit_crossings."""
    refractory, count_thresholds, emit_crossings = (
        features.refractory,
        make_count_thresholds(features),
        make_emit_crossings(features, at_once),
    )
    crossing_key = make_crossing_key(features)

    @wp.func(inline=True)
    def fire_jump(
        # in
        sensor: Sensor,
        t_base: wp.int64,
        step: Step,
        signal: Signal,
        own: PixelParameters,
        # in and out
        state: Rare,
        progress: StepProgress,
        # out
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        """Fires the crossings of a jump to the level of the frame at the step's end, unless the pixel is
        refractory then."""
        if not refractory_beyond(state.refractory_until, step.now):
            zero = wp.float64(0.0)
            delta = signal.l1 + own.drift * wp.float64(step.now - state.origin) - progress.reference
            on = delta > zero
            n, signed = count_thresholds(delta, own.c_on, own.c_off)
            progress.u = wp.float64(1.0)
            progress.last_time = step.now
            level = wp.vec4d(signal.l1, zero, zero, zero)
            key = crossing_key(progress, step, signal, own, state.origin, on)
            emit_crossings(sensor, t_base, step, level, progress, signed, n, progress.u, step.now, key, keys, counters)
            state.net = state.net + wp.where(on, n, -n)
            state.n_off = state.n_off + wp.where(on, 0, n)
            if wp.static(refractory):
                if n > 0:
                    state.refractory_until = refractory_end(sensor, step.now)
        return state

    return fire_jump


@lru_cache
def make_take_step(features: Features, at_once: Any = None) -> Any:
    """Makes the function `take_step`. at_once: as of make_emit_crossings."""
    frame, curved, spontaneous = (
        features.crossing == "frame",
        features.curved,
        features.noise or features.bernoulli_leak,
    )
    refractory = features.refractory
    end_refractory, fire_by_noise = make_end_refractory(features), make_fire_by_noise(features)
    fire_crossings, fire_jump = make_fire_crossings(features, at_once), make_fire_jump(features, at_once)

    @wp.func(inline=True)
    def take_step(
        # in
        sensor: Sensor,
        place: Place,
        message: Message,
        step: Step,
        signal: Signal,
        own: PixelParameters,
        leak_event_at: wp.int64,
        # in and out
        state: Rare,
        # out
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        """Takes a pixel through a step, from one happening to the next; returns its state after the step.

        leak_event_at: when the Bernoulli leak fires in this step, or NEVER.
        """
        turns = wp.vec2d(wp.float64(2.0), wp.float64(2.0))
        if wp.static(curved):
            turns = turning_points(signal.s)
        progress = begin_step(sensor, place, step, leak_event_at, own, state, 0)
        going = bool(True)
        while going:
            if wp.static(refractory):
                if refractory_beyond(state.refractory_until, step.now):
                    break
                state, progress = end_refractory(sensor, place, message, step, signal, own, state, progress)
            until = wp.int64(step.now)
            u_end = wp.float64(1.0)
            by_noise = bool(False)
            if wp.static(spontaneous):
                soonest = wp.min(state.next_noise, progress.leak_event_at)
                if soonest <= step.now:
                    until = soonest
                    u_end = wp.float64(until - step.start) * step.per_h
                    by_noise = True
            became_refractory, state, progress = fire_crossings(
                sensor, message.t_base, step, signal, own, turns, until, u_end, state, progress, keys, counters
            )
            going = became_refractory or by_noise
            if wp.static(spontaneous):
                due = by_noise and not became_refractory
                state, progress = fire_by_noise(
                    sensor, place, message, step, signal, own, due, until, u_end, state, progress, keys, counters
                )
        if wp.static(frame):
            state = fire_jump(sensor, message.t_base, step, signal, own, state, progress, keys, counters)
        return state

    return take_step
