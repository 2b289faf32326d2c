# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Takes a pixel with curves between frames and with faults through a message in the order of time; only what is asked
for is compiled.

Here a pixel is taken from frame to frame: whether something may happen to it in a step, the curve of the step, the
range it is left with. What happens within the step is in nodes.event_sensor.model.pixel_step_kernels.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from nodes.event_sensor.input.between_kernels import further_entries
from nodes.event_sensor.model.curve_kernels import make_step_curve
from nodes.event_sensor.model.episode_kernels import make_begin_episode, make_read_state
from nodes.event_sensor.model.faults.leak_kernels import bernoulli_leak_time
from nodes.event_sensor.model.faults.noise_kernels import stream_here
from nodes.event_sensor.model.faults.random_kernels import NEVER
from nodes.event_sensor.model.features import Features
from nodes.event_sensor.model.inactive_kernels import make_curve_inactive, make_update_inactive_range
from nodes.event_sensor.model.pixel_step_kernels import make_take_step
from nodes.event_sensor.model.sample_kernels import make_inactive_frames, make_next_further_sample, make_sample_at
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
    UNKNOWN_LEVEL,
    Frequent,
    FrequentState,
    Rare,
    read_frequent,
    write_frequent,
)
from nodes.event_sensor.model.step_kernels import Levels, Message, PixelParameters, Place, Sample, Signal, Step

wp.set_module_options({"enable_backward": False})


@wp.func
def no_levels():
    """Returns Levels of which none is known."""
    levels = Levels()
    levels.earlier = UNKNOWN_LEVEL
    levels.early = UNKNOWN_LEVEL
    levels.last = UNKNOWN_LEVEL
    levels.next = UNKNOWN_LEVEL
    return levels


@lru_cache
def make_step_signal(features: Features) -> Any:
    """Makes the function `step_signal`."""
    frame, leak, curved = features.crossing == "frame", features.leak, features.curved
    step_curve = make_step_curve(features)

    @wp.func(inline=True)
    def step_signal(
        # in
        sensor: Sensor,
        message: Message,
        step: Step,
        start_before: wp.int64,
        frequent: Frequent,
        sample: Sample,
        own: PixelParameters,
        origin: wp.int64,
        # in and out
        levels: Levels,
        # out
        counters: wp.array(dtype=wp.int64),
    ):
        """Computes the curve S(u) of a step, and L of the samples that it needed.

        start_before: when the step before began. origin: where the leak's drift is zero [ns].
        """
        zero = wp.float64(0.0)
        if levels.last == UNKNOWN_LEVEL:
            levels.last = log_level(sensor, frequent.last)
        l1 = wp.float64(levels.next)
        if l1 == UNKNOWN_LEVEL:
            l1 = log_level(sensor, sample.light)
        s = wp.vec4d(levels.last, wp.where(wp.static(frame), zero, l1 - levels.last), zero, zero)
        if wp.static(curved):
            h_before = wp.float64(step.start - start_before)
            h_after = wp.float64(1.0)
            if sample.has_next:
                h_after = wp.float64(message.t[step.k + 1] - step.now)
            s, levels = step_curve(sensor, frequent, sample, l1, step.h, h_before, h_after, levels, counters)
        s[0] = s[0] + own.drift * wp.float64(step.start - origin)
        if wp.static(leak):
            s[1] = s[1] + own.drift * step.h
        signal = Signal()
        signal.s = s
        signal.l1 = l1
        signal.last = frequent.last
        signal.light = sample.light
        return signal, levels

    return step_signal


@lru_cache
def make_pass_inactive(features: Features) -> Any:
    """Makes the function `pass_inactive`."""
    curved, hermite = features.curved, features.crossing == "hermite"

    @wp.func(inline=True)
    def pass_inactive(inactive: wp.bool, frequent: Frequent, sample: Sample, levels: Levels):
        """Moves samples on by a step, if the pixel was inactive in it; nobody computed its levels."""
        if inactive:
            if wp.static(curved):
                frequent.earlier = frequent.early
                frequent.early = wp.where(wp.static(hermite), sample.slope, frequent.last)
            frequent.last = sample.light
            levels.earlier = UNKNOWN_LEVEL
            levels.early = UNKNOWN_LEVEL
            levels.last = UNKNOWN_LEVEL
            levels.next = UNKNOWN_LEVEL
        return frequent, levels

    return pass_inactive


@lru_cache
def make_sense_step(features: Features, at_once: Any = None) -> Any:
    """Makes the function `sense_step`. at_once: as of make_emit_crossings."""
    ahead, hermite = features.ahead, features.crossing == "hermite"
    step_signal, take_step = make_step_signal(features), make_take_step(features, at_once)

    @wp.func(inline=True)
    def sense_step(
        # in
        sensor: Sensor,
        place: Place,
        message: Message,
        step: Step,
        start_before: wp.int64,
        sample: Sample,
        own: PixelParameters,
        leak_event_at: wp.int64,
        active: wp.bool,
        held: wp.bool,
        # in and out
        state: Rare,
        frequent: Frequent,
        levels: Levels,
        # out
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        """Takes a pixel that has a reference through a step, if it is active in it; see take_step.

        held: the sample is the last good one in the place of a bad one, and was counted when it came.
        """
        if active:
            if not held:
                count_clipped(sensor, sample.light, counters)
            signal, known = step_signal(
                sensor, message, step, start_before, frequent, sample, own, state.origin, levels, counters
            )
            after = take_step(sensor, place, message, step, signal, own, leak_event_at, state, keys, counters)
            state.base = after.base
            state.net = after.net
            state.n_off = after.n_off
            state.refractory_until = after.refractory_until
            state.next_noise = after.next_noise
            state.noise_draws = after.noise_draws
            if wp.static(ahead):
                frequent.earlier = frequent.early
                frequent.early = frequent.last
                levels.earlier = known.early
                levels.early = known.last
                levels.next = known.next
            if wp.static(hermite):
                frequent.earlier = frequent.early
                frequent.early = sample.slope
            frequent.last = sample.light
            levels.moved = wp.abs(signal.l1 - known.last)
            levels.last = signal.l1
        return state, frequent, levels

    return sense_step


@lru_cache
def make_sense_pixel(features: Features, at_once: Any = None) -> Any:
    """Makes the function `sense_pixel`. at_once: as of make_emit_crossings."""
    surely_active = features.range_decides or at_once is not None
    curved, timed, range_decides, bernoulli_leak = (
        features.curved,
        features.timed,
        features.range_decides,
        features.bernoulli_leak,
    )
    further, next_further_sample = features.further, make_next_further_sample(features)
    inactive_frames, sample_at = make_inactive_frames(features), make_sample_at(features)
    curve_inactive, update_inactive_range = make_curve_inactive(features), make_update_inactive_range(features)
    read_state, begin_episode, pass_inactive = (
        make_read_state(features),
        make_begin_episode(features),
        make_pass_inactive(features),
    )
    sense_step = make_sense_step(features, at_once)

    @wp.func(inline=True)
    def sense_pixel(
        # in
        sensor: Sensor,
        place: Place,
        begin: wp.int32,
        message: Message,
        before: FrequentState,
        side_before: wp.array(dtype=wp.int32),
        # out
        after: FrequentState,
        side_after: wp.array(dtype=wp.int32),
        rare: wp.array2d(dtype=Rare),
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        """Takes a pixel through the samples of a message; writes its events as keys, and counts."""
        index = place.index
        stride = wp.int64(sensor.height * sensor.width * sensor.channels)
        first = wp.int64(place.env) * wp.int64(message.frames) * stride + wp.int64(place.inner)
        two_sided = rare.shape[0] == 2
        side = int(0)
        if two_sided:
            side = side_before[index]
        frequent = read_frequent(before, index)
        step = Step()
        step.start = message.t_base
        start_before = wp.int64(message.t_before)
        k = int(0)
        entry = int(0)  # of the further samples, the next one
        entries = int(0)  # and where they end
        if wp.static(further):
            entry, entries = further_entries(message.between, index)
        if wp.static(range_decides):
            # Most pixels are inactive through the whole message: the short way.
            if begin == 0 and entry == entries:
                at_rest, last = inactive_frames(message, frequent, first, stride)
                k = at_rest
                frequent.last = last
                if k == message.count:
                    write_frequent(after, index, frequent)
                    if two_sided:
                        side_after[index] = side
                    return
                if k > 0:
                    step.start = message.t[k - 1]
        # A pixel that a CPU has listed, or whose range decides and was left, is active; of others most are not.
        loaded = bool(surely_active)
        state, own = read_state(sensor, rare, side, index, loaded, Rare(), PixelParameters())
        levels = no_levels()
        stream = wp.uint64(0)
        stream_known = bool(False)  # the stream is known
        while k < message.count:
            step.k = k
            step.now = message.t[k]
            sample = sample_at(sensor, message, begin, k, first, stride)
            between, step, sample = next_further_sample(message, place, entry, entries, step, sample)
            begins = k < 2 and ((begin >> k) & 1) != 0 and not between
            if begins:
                frequent.low = float(wp.inf)
                stream_known = False
            inactive = sample.light >= frequent.low and sample.light <= frequent.high
            if wp.static(timed):
                inactive = inactive and step.now < frequent.wake
            if wp.static(curved):
                inactive = inactive and curve_inactive(sensor, frequent, sample, step.now - step.start)
            leak_event_at = NEVER
            if wp.static(bernoulli_leak):
                if not begins and frequent.low <= LARGEST:
                    if not stream_known:
                        stream = stream_here(sensor, place.env, place.inner, message.episodes, k)
                        stream_known = True
                    origin = rare[side, index].origin
                    if loaded:
                        origin = state.origin  # of an episode that began in this message, too
                    leak_event_at = bernoulli_leak_time(
                        stream, rare[side, index].leak_rate, step.start, step.now, origin
                    )
                    inactive = inactive and leak_event_at == NEVER
            frequent, levels = pass_inactive(inactive, frequent, sample, levels)
            held = not inactive and not has_level(sensor, sample.light)
            if wp.static(not surely_active):
                state, own = read_state(sensor, rare, side, index, not inactive and not loaded, state, own)
                loaded = loaded or not inactive
            fresh = frequent.low > LARGEST
            if held:
                wp.atomic_add(counters, NONFINITE, wp.int64(1))
                sample.light = frequent.last
                sample.slope = 0.0
            starts = fresh and not inactive and not held
            active = not fresh and not inactive
            state, frequent, levels = begin_episode(
                sensor, place, message, step, sample, own, starts, state, frequent, levels, counters
            )
            step.h = wp.float64(step.now - step.start)
            step.per_h = wp.float64(1.0) / step.h
            state, frequent, levels = sense_step(
                sensor, place, message, step, start_before, sample, own, leak_event_at, active, held,
                state, frequent, levels, keys, counters,
            )  # fmt: skip
            frequent = update_inactive_range(sensor, step, own, levels, not inactive, state, frequent)
            start_before = step.start
            step.start = step.now
            if between:
                entry += 1
            else:
                k += 1
        if counters[EVENTS] <= sensor.capacity:
            if loaded:
                if two_sided:
                    side = 1 - side
                rare[side, index] = state
            write_frequent(after, index, frequent)
            if two_sided:
                side_after[index] = side

    return sense_pixel
