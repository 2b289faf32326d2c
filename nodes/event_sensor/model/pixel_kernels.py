# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Takes a pixel with curves between frames and with faults through a message in the order of time; only what is asked
for is compiled.

Here a pixel is taken from frame to frame: whether something may happen to it in a step, the curve of the step, the
range it is left with. What happens within the step is in nodes.event_sensor.model.pixel_step_kernels.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from nodes.event_sensor.model.curve_kernels import slope_of, step_curve
from nodes.event_sensor.model.episode_kernels import episode_start, own_parameters
from nodes.event_sensor.model.faults.leak_kernels import coin_time
from nodes.event_sensor.model.faults.noise_kernels import stream_here
from nodes.event_sensor.model.faults.random_kernels import NEVER
from nodes.event_sensor.model.features import Features
from nodes.event_sensor.model.inactive_kernels import range_left, surely_inactive
from nodes.event_sensor.model.pixel_step_kernels import pixel_step
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
    NOWHERE,
    Frequent,
    FrequentState,
    Rare,
    read_frequent,
    write_frequent,
)
from nodes.event_sensor.model.step_kernels import Levels, Message, Own, Place, Sample, Signal, Step

wp.set_module_options({"enable_backward": False})


@wp.func
def place_of(sensor: Sensor, env: wp.int32, y: wp.int32, x: wp.int32, c: wp.int32):
    """Returns the Place of a pixel and channel."""
    place = Place()
    place.env = env
    place.y = y
    place.x = x
    place.c = c
    place.inner = (y * sensor.width + x) * sensor.channels + c
    place.index = env * (sensor.height * sensor.width * sensor.channels) + place.inner
    return place


@wp.func
def no_levels():
    """Returns Levels of which none is known."""
    levels = Levels()
    levels.earlier = NOWHERE
    levels.early = NOWHERE
    levels.last = NOWHERE
    levels.next = NOWHERE
    return levels


@lru_cache
def frames_at_rest(features: Features) -> Any:
    """Makes the function of how many frames of a message a pixel is inactive for."""
    timed = features.timed

    @wp.func(inline=True)
    def inactive_frames(message: Message, frequent: Frequent, first: wp.int64, stride: wp.int64):
        """Counts the frames before the first that may do something; returns the last sample of them too.

        first: of the pixel's sample in the first frame; stride: from frame to frame.
        """
        last = frequent.last
        k = int(0)
        while k < message.count:
            sample = message.luminance[first + wp.int64(k) * stride]
            if not (sample >= frequent.low and sample <= frequent.high):
                break
            if wp.static(timed):
                if message.t[k] >= frequent.wake:
                    break
            last = sample
            k += 1
        return k, last

    return inactive_frames


@lru_cache
def sample_read(features: Features) -> Any:
    """Makes the function of what a step reads of the frames at its end and after it."""
    ahead, hermite = features.ahead, features.crossing == "hermite"

    @wp.func(inline=True)
    def sample_at(
        sensor: Sensor, message: Message, begin: wp.int32, k: wp.int32, first: wp.int64, stride: wp.int64
    ):  # fmt: skip
        """Reads the sample of frame k; see frames_at_rest."""
        sample = Sample()
        sample.light = message.luminance[first + wp.int64(k) * stride]
        sample.following = sample.light
        if wp.static(ahead):
            sample.has_next = k + 1 < message.frames and not (k == 0 and (begin & 2) != 0)
            if sample.has_next:
                sample.following = message.luminance[first + wp.int64(k + 1) * stride]
        if wp.static(hermite):
            sample.slope = slope_of(sensor, message.dlog_dt[first + wp.int64(k) * stride], sample.light)
        return sample

    return sample_at


@lru_cache
def next_sample(features: Features) -> Any:
    """Makes the function that tells whether a further sample of a pixel comes before the next frame."""
    further = features.further

    @wp.func(inline=True)
    def before_frame(
        # in
        message: Message,
        place: Place,
        entry: wp.int32,
        end: wp.int32,
        # in and out
        step: Step,
        sample: Sample,
    ):
        """Returns True, and the step and the sample at its end, where entry number `entry` of the list is next."""
        found = bool(False)
        if wp.static(further):
            if entry < end:
                now = message.t_base + wp.int64(message.between.offset[entry])
                if now < step.now:
                    found = True
                    step.now = now
                    shared = message.between.shared
                    value = wp.int64(entry) * wp.int64(shared) + wp.int64(place.index % shared)
                    sample.light = message.between.value[value]
        return found, step, sample

    return before_frame


@lru_cache
def step_signal(features: Features) -> Any:
    """Makes the function of what a pixel sees in a step."""
    frame, leak, curved = features.crossing == "frame", features.leak, features.curved
    curve = step_curve(features)

    @wp.func(inline=True)
    def signal_of(
        # in
        sensor: Sensor,
        message: Message,
        step: Step,
        start_before: wp.int64,
        frequent: Frequent,
        sample: Sample,
        own: Own,
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
        if levels.last == NOWHERE:
            levels.last = log_level(sensor, frequent.last)
        l1 = wp.float64(levels.next)
        if l1 == NOWHERE:
            l1 = log_level(sensor, sample.light)
        s = wp.vec4d(levels.last, wp.where(wp.static(frame), zero, l1 - levels.last), zero, zero)
        if wp.static(curved):
            h_before = wp.float64(step.start - start_before)
            h_after = wp.float64(1.0)
            if sample.has_next:
                h_after = wp.float64(message.t[step.k + 1] - step.now)
            s, levels = curve(sensor, frequent, sample, l1, step.h, h_before, h_after, levels, counters)
        s[0] = s[0] + own.drift * wp.float64(step.start - origin)
        if wp.static(leak):
            s[1] = s[1] + own.drift * step.h
        signal = Signal()
        signal.s = s
        signal.l1 = l1
        signal.last = frequent.last
        signal.light = sample.light
        return signal, levels

    return signal_of


@lru_cache
def passed_step(features: Features) -> Any:
    """Makes the function of what the next step looks back at after one in which a pixel was inactive."""
    curved, hermite = features.curved, features.crossing == "hermite"

    @wp.func(inline=True)
    def passed(inactive: wp.bool, frequent: Frequent, sample: Sample, levels: Levels):
        """Moves samples on by a step, if the pixel was inactive in it; nobody computed its levels."""
        if inactive:
            if wp.static(curved):
                frequent.earlier = frequent.early
                frequent.early = wp.where(wp.static(hermite), sample.slope, frequent.last)
            frequent.last = sample.light
            levels.earlier = NOWHERE
            levels.early = NOWHERE
            levels.last = NOWHERE
            levels.next = NOWHERE
        return frequent, levels

    return passed


@lru_cache
def active_step(features: Features, at_once: Any = None) -> Any:
    """Makes the function of a step in which something may happen."""
    ahead, hermite = features.ahead, features.crossing == "hermite"
    signal_of, take_step = step_signal(features), pixel_step(features, at_once)

    @wp.func(inline=True)
    def sense_step(
        # in
        sensor: Sensor,
        place: Place,
        message: Message,
        step: Step,
        start_before: wp.int64,
        sample: Sample,
        own: Own,
        coin_at: wp.int64,
        active: wp.bool,
        # in and out
        state: Rare,
        frequent: Frequent,
        levels: Levels,
        # out
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        """Takes a pixel that has a reference through a step, if it is active in it; see pixel_step."""
        if active:
            count_clipped(sensor, sample.light, counters)
            signal, known = signal_of(
                sensor, message, step, start_before, frequent, sample, own, state.origin, levels, counters
            )
            after = take_step(sensor, place, message, step, signal, own, coin_at, state, keys, counters)
            state.base = after.base
            state.net = after.net
            state.n_off = after.n_off
            state.dead = after.dead
            state.next = after.next
            state.draws = after.draws
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
def sense_pixel(features: Features, at_once: Any = None) -> Any:
    """Makes the function of all steps of one pixel in a message. at_once: see emission_kernels.crossings_fired."""
    surely_active = features.hasty or at_once is not None
    curved, timed, hasty, coin = features.curved, features.timed, features.hasty, features.coin
    further, before_frame = features.further, next_sample(features)
    inactive_frames, sample_at = frames_at_rest(features), sample_read(features)
    curve_inactive, rest = surely_inactive(features), range_left(features)
    read_own, begin_episode, passed = own_parameters(features), episode_start(features), passed_step(features)
    sense_step = active_step(features, at_once)

    @wp.func(inline=True)
    def sense(
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
            entry = message.between.first[index // message.between.shared]
            entries = message.between.first[index // message.between.shared + 1]
        if wp.static(hasty):
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
        # A pixel that a CPU has listed, or that is hasty and here, is active; of others most are not.
        loaded = bool(surely_active)
        state, own = read_own(sensor, rare, side, index, loaded, Rare(), Own())
        levels = no_levels()
        stream = wp.uint64(0)
        named = bool(False)  # the stream is known
        while k < message.count:
            step.k = k
            step.now = message.t[k]
            sample = sample_at(sensor, message, begin, k, first, stride)
            between, step, sample = before_frame(message, place, entry, entries, step, sample)
            begins = k < 2 and ((begin >> k) & 1) != 0 and not between
            if begins:
                frequent.low = float(wp.inf)
                named = False
            inactive = sample.light >= frequent.low and sample.light <= frequent.high
            if wp.static(timed):
                inactive = inactive and step.now < frequent.wake
            if wp.static(curved):
                inactive = inactive and curve_inactive(sensor, frequent, sample, step.now - step.start)
            coin_at = NEVER
            if wp.static(coin):
                if not begins and frequent.low <= LARGEST:
                    if not named:
                        stream = stream_here(sensor, place.env, place.inner, message.episodes, k)
                        named = True
                    origin = rare[side, index].origin
                    if loaded:
                        origin = state.origin  # of an episode that began in this message, too
                    coin_at = coin_time(stream, rare[side, index].leak, step.start, step.now, origin)
                    inactive = inactive and coin_at == NEVER
            frequent, levels = passed(inactive, frequent, sample, levels)
            held = not inactive and not has_level(sensor, sample.light)
            if wp.static(not surely_active):
                state, own = read_own(sensor, rare, side, index, not inactive and not loaded, state, own)
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
                sensor, place, message, step, start_before, sample, own, coin_at, active,
                state, frequent, levels, keys, counters,
            )  # fmt: skip
            frequent = rest(sensor, step, own, levels, not inactive, state, frequent)
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

    return sense
