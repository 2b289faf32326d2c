# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Senses the ideal sensor's active pixels on a GPU: the second pass, after `active_kernels.py` has listed them.

It has a thread for every pixel that left its range, so that a warp does not wait for the few that fire. Pixels that
have further samples between the frames are sensed sample by sample in the order of time.

State is changed in place. A pixel that finds no room for the events of a step leaves its state as it was before that
step and the number of its sample, among the pixel's, in the list of active pixels; the next launch, with more room,
goes on from there.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from evis.gpu.append_kernels import take_room
from nodes.event_sensor.cuda.call_kernels import ACTIVE, BLOCKED, FULL_FROM, IMAGES, STAMPS, T_BASE
from nodes.event_sensor.cuda.further_kernels import (
    further_entries,
    further_is_next,
    offset_at,
    sample_before,
    value_at,
)
from nodes.event_sensor.model.crossing_kernels import crossing_on_line
from nodes.event_sensor.model.key_kernels import key_head, key_tail, key_time
from nodes.event_sensor.model.sensor_kernels import (
    EVENTS,
    LARGEST,
    NONFINITE,
    TOLERANCE,
    Sensor,
    count_clipped,
    has_level,
    log_level,
)
from nodes.event_sensor.model.state_kernels import Pixel
from nodes.event_sensor.model.threshold_kernels import range_around, reference_level, thresholds_crossed

wp.set_module_options({"enable_backward": False})

AHEAD = 4
"""Samples of a pixel that are loaded together where a thread goes on to its own next event."""


@wp.struct
class IdealState:
    """Keeps of every pixel and channel what model.state_kernels.Pixel names; the reference's base apart."""

    last: wp.array(dtype=wp.float32)
    low: wp.array(dtype=wp.float32)
    high: wp.array(dtype=wp.float32)
    counts: wp.array(dtype=wp.vec2i)
    base: wp.array(dtype=wp.float64)


@wp.func
def in_range(v: wp.float32, low: wp.float32, high: wp.float32):
    """Returns 1 in the range, 0 outside and for NaN."""
    return wp.where(v >= low and v <= high, 1, 0)


@wp.func
def tail_of(sensor: Sensor, inner: wp.int32, on: wp.bool):
    """Gives key_tail of an event by the number of its pixel and channel in the environment."""
    c = inner % sensor.channels
    x = (inner // sensor.channels) % sensor.width
    return key_tail(sensor, inner // (sensor.channels * sensor.width), x, c, on)


@lru_cache
def make_write_events(frame: bool) -> wp.Function:
    """Makes the function `write_events`; frame: as of make_sense_active."""

    @wp.func
    def write_events(
        sensor: Sensor,
        tail: wp.int64,
        env: wp.int32,
        n: wp.int32,
        signed: wp.float64,
        reference: wp.float64,
        l0: wp.float64,
        l1: wp.float64,
        start: wp.int64,
        span: wp.int64,
        slot: wp.int64,
        keys: wp.array(dtype=wp.int64),
    ):
        """Writes n events of a step to `keys` from `slot` on.

        tail: as of key_tail. signed: threshold with its sign; reference: L_ref before the step. l0, l1: L at its ends;
        start: when it begins [ns after the call's start]; span: how long it is [ns].
        """
        slope = wp.float64(span) / (l1 - l0)
        head = key_head(sensor, env)
        m = int(0)
        while m < n:
            ns = crossing_on_line(reference + wp.float64(m + 1) * signed, l0, slope, wp.float64(span))
            if wp.static(frame):
                ns = span
            keys[slot + wp.int64(m)] = head | key_time(sensor, start + ns) | tail
            m += 1

    return write_events


@wp.func
def inactive_samples(
    images: wp.array(dtype=wp.float32),
    at: wp.int64,
    stride: wp.int64,
    k: wp.int32,
    frames: wp.int32,
    low: wp.float32,
    high: wp.float32,
):
    """Returns the number of samples from k on that are in the range, the last of all samples never among them.

    images, at, stride: where a pixel's samples are. low, high: the range.
    """
    first = int(k)
    on = bool(True)
    while on and k + wp.static(AHEAD) < frames:
        found = wp.vec4f()
        for j in range(wp.static(AHEAD)):
            found[j] = images[at + wp.int64(k + j) * stride]
        for j in range(wp.static(AHEAD)):
            on = on and in_range(found[j], low, high) != 0
            k += wp.where(on, 1, 0)
    while on and k < frames - 1:
        on = in_range(images[at + wp.int64(k) * stride], low, high) != 0
        k += wp.where(on, 1, 0)
    return k - first


@lru_cache
def make_sense_pixel(frame: bool, ahead: bool, room: Any) -> wp.Function:
    """Makes the function `sense_pixel`; arguments as of make_sense_active."""
    write_events = make_write_events(frame)

    @wp.func
    def sense_pixel(
        # in
        sensor: Sensor,
        call: wp.array(dtype=wp.int64),
        frames: wp.int32,
        size: wp.int32,
        index: wp.int32,
        first: wp.int32,
        # in and out
        state: IdealState,
        # out
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        """Takes a pixel through its samples from number `first` on; returns that whose events found no room, or -1.

        Args:
            sensor, call, frames: as in source.Source.
            size: pixels and channels of an environment.
            index: the pixel among all.
            first: sample to go on from; those of frames and those between count together.
            state: of all pixels.
            keys, counters: the list of events, and how many there are.
        """
        env = index // size
        inner = index - env * size
        stride = wp.int64(size)
        images = wp.array(ptr=wp.uint64(call[IMAGES]), shape=(1,), dtype=wp.float32)
        at = wp.int64(env) * stride * wp.int64(frames) + wp.int64(inner)
        t_base = call[T_BASE]
        pixel = Pixel()
        pixel.last = state.last[index]
        pixel.low = state.low[index]
        pixel.high = state.high[index]
        pixel.net = state.counts[index][0]
        pixel.n_off = state.counts[index][1]
        base = state.base[index]
        if first == 0 and call[STAMPS + frames + env] != wp.int64(0):
            pixel.low = float(wp.inf)
        entries = further_entries(call, index)
        k, entry, start = sample_before(call, entries, first)
        number = wp.int32(first)
        l_last = wp.float64(0.0)
        last_known = bool(False)
        without_room = int(-1)
        following = images[at + wp.int64(k) * stride]
        while k < frames:
            if wp.static(ahead) and entry == entries[1]:
                # Every thread goes on to its own next event first, so that those of a warp work theirs out together.
                skipped = inactive_samples(images, at, stride, k, frames, pixel.low, pixel.high)
                if skipped > 0:
                    k += skipped
                    number += skipped
                    start = call[STAMPS + k - 1]
                    pixel.last = images[at + wp.int64(k - 1) * stride]
                    following = images[at + wp.int64(k) * stride]
                    last_known = bool(False)
            v = following
            now = call[STAMPS + k]
            between = further_is_next(call, entry, entries[1], now)
            if between:
                now = t_base + offset_at(call, entry)
                v = value_at(call, entry, index)
            else:
                # On its way while this one is dealt with.
                following = images[at + wp.int64(wp.min(k + 1, frames - 1)) * stride]
            if v >= pixel.low and v <= pixel.high:
                pixel.last = v
                last_known = bool(False)
            elif not has_level(sensor, v):
                # The last good value is held, so the next step starts here and its events are later than this.
                wp.atomic_add(counters, NONFINITE, wp.int64(1))
            elif pixel.low > LARGEST:
                base = log_level(sensor, v)
                pixel.net = 0
                pixel.n_off = 0
                limits = range_around(sensor, base)
                pixel.low = limits[0]
                pixel.high = limits[1]
                pixel.last = v
                count_clipped(sensor, v, counters)
            else:
                l0 = l_last
                if not last_known:
                    l0 = log_level(sensor, pixel.last)
                l1 = log_level(sensor, v)
                reference = reference_level(base, pixel.net, pixel.n_off, sensor.threshold_on, sensor.threshold_off)
                delta = l1 - reference
                on = delta > wp.float64(0.0)
                n, signed = thresholds_crossed(delta, sensor.threshold_on, sensor.threshold_off, TOLERANCE)
                if n > 0:
                    slot = room(counters, EVENTS, n)
                    if slot + wp.int64(n) > sensor.capacity:
                        wp.atomic_min(counters, FULL_FROM, slot)
                        without_room = number
                        break
                    write_events(
                        sensor, tail_of(sensor, inner, on), env, n, signed, reference, l0, l1, start - t_base,
                        now - start, slot, keys,
                    )  # fmt: skip
                    if on:
                        pixel.net = pixel.net + n
                    else:
                        pixel.net = pixel.net - n
                        pixel.n_off = pixel.n_off + n
                    limits = range_around(sensor, reference + wp.float64(n) * signed)
                    pixel.low = limits[0]
                    pixel.high = limits[1]
                count_clipped(sensor, v, counters)
                pixel.last = v
                l_last = l1
                last_known = bool(True)
            start = now
            number += 1
            if between:
                entry += 1
            else:
                k += 1
        state.last[index] = pixel.last
        state.low[index] = pixel.low
        state.high[index] = pixel.high
        state.counts[index] = wp.vec2i(pixel.net, pixel.n_off)
        state.base[index] = base
        return without_room

    return sense_pixel


@lru_cache
def make_sense_active(frame: bool, ahead: bool = False, room: Any = take_room) -> wp.Kernel:
    """Makes the kernel over the listed pixels.

    frame: events carry the stamp of their frame, not of their crossing. ahead: each thread goes on to its own next
    event by itself, instead of from sample to sample with the others of its warp; the events are the same. room: how a
    pixel takes room for its events.
    """
    sense_pixel = make_sense_pixel(frame, ahead, room)

    @wp.kernel(module="unique", enable_backward=False)
    def sense_active(
        # in
        sensor: Sensor,
        call: wp.array(dtype=wp.int64),
        frames: wp.int32,
        size: wp.int32,
        threads: wp.int32,
        # in and out
        state: IdealState,
        active: wp.array(dtype=wp.vec2i),
        # out
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        """Senses the listed pixels; a thread takes every `threads`-th.

        Args:
            sensor, call, frames: as in source.Source.
            size: pixels and channels of an environment.
            threads: how many there are.
            state: of all pixels.
            active: as of find_active; -1 for a pixel that is done, else the sample whose events found no room.
            keys, counters: the list of events, and how many there are.
        """
        if counters[BLOCKED] != wp.int64(0):
            return
        listed = wp.int32(counters[ACTIVE])
        j = wp.tid()
        while j < listed:
            index = active[j][0]
            if index >= 0:
                without_room = sense_pixel(sensor, call, frames, size, index, active[j][1], state, keys, counters)
                active[j] = wp.vec2i(wp.where(without_room < 0, -1, index), without_room)
            j += threads

    return sense_active
