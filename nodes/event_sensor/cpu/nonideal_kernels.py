# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Senses with curves and faults on a CPU: a thread takes a row, in which the active pixels are listed and then sensed.

State is changed in place: a pixel that finds no room for its events leaves its state as it was and its number in
counters[LEFT], every later one does nothing, and the next launch goes on from there.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from nodes.event_sensor.cpu.active_kernels import list_active_row
from nodes.event_sensor.cpu.crossings_simd_kernels import crossings_at_once
from nodes.event_sensor.cpu.run_kernels import make_pass_inactive, make_run_margins
from nodes.event_sensor.input.between_kernels import Between
from nodes.event_sensor.model.features import Features
from nodes.event_sensor.model.pixel_kernels import make_sense_pixel
from nodes.event_sensor.model.sensor_kernels import EVENTS, LEFT, Sensor
from nodes.event_sensor.model.state_kernels import RUN, FrequentState, Rare, Run
from nodes.event_sensor.model.step_kernels import Message, message_of, place_of

wp.set_module_options({"enable_backward": False})


@wp.func_native("__builtin_prefetch(&wp::index(rare, 0, pixel), 1, 3);")
def fetch(rare: wp.array2d(dtype=Rare), pixel: wp.int32):
    """Prefetches the state that is kept of a pixel."""
    ...


@wp.func
def saved(counters: wp.array(dtype=wp.int64)):
    """Returns the counters before a pixel."""
    return wp.vector(counters[0], counters[1], counters[2], counters[3], counters[4])


@wp.func
def left_over(
    sensor: Sensor, before: wp.types.vector(length=5, dtype=wp.int64), index: wp.int32,
    counters: wp.array(dtype=wp.int64),
):  # fmt: skip
    """Restores the counters of before this pixel, and returns True, where its events did not fit."""
    if counters[EVENTS] <= sensor.capacity:
        return False
    for i in range(5):
        counters[i] = before[i]
    counters[LEFT] = wp.int64(index + 1)
    return True


@wp.func
def longest_step(t: wp.array(dtype=wp.int64), t_base: wp.int64, count: wp.int32):
    """Gives the length of the longest step of a message [ns]."""
    longest = wp.float32(t[0] - t_base)
    k = int(1)
    while k < count:
        longest = wp.max(longest, wp.float32(t[k] - t[k - 1]))
        k += 1
    return longest


@lru_cache
def make_list_row(features: Features) -> Any:
    """Makes the function `list_row`."""
    run_margins, (pass_inactive_run, pass_inactive_pixel) = make_run_margins(features), make_pass_inactive(features)

    @wp.func(inline=True)
    def list_row(
        # in
        sensor: Sensor,
        message: Message,
        luminance_runs: wp.array(dtype=Run),
        slope_runs: wp.array(dtype=Run),
        start: wp.int32,
        row: wp.int32,
        at_first: wp.int64,
        stride: wp.int64,
        whole: wp.bool,
        # in and out
        state: FrequentState,
        # out
        rare: wp.array2d(dtype=Rare),
        active: wp.array(dtype=wp.int32),
    ):
        """Lists the pixels of a row to which something may happen, and keeps what is needed of the others.

        start, at_first: of the row's first pixel, in the state and in the first frame. row: its pixels. stride: from
        frame to frame. whole: runs of pixels may be tested as a whole. active: as of list_active_row.
        """
        count = message.count
        at_end = at_first + wp.int64(count - 1) * stride
        t_end = message.t[count - 1]
        longest = longest_step(message.t, message.t_base, count)
        active[0] = 0
        i = int(0)
        margins = Run()
        while i < row:
            many = wp.min(row - i, wp.static(RUN))
            margins = Run(-1.0)
            if wp.static(not features.bernoulli_leak and features.curved):
                if whole and many == wp.static(RUN):
                    margins = run_margins(
                        sensor, state, luminance_runs, slope_runs, start + i, at_first + wp.int64(i), stride, count,
                        longest, t_end,
                    )  # fmt: skip
                    if wp.min(margins) >= 0.0:
                        pass_inactive_run(
                            sensor, message.luminance, luminance_runs, message.dlog_dt, slope_runs, start + i,
                            at_end + wp.int64(i), stride, count, state,
                        )  # fmt: skip
                        i += wp.static(RUN)
                        continue
            place_in_run = int(0)
            while place_in_run < many:
                if margins[place_in_run] >= 0.0:
                    pass_inactive_pixel(
                        sensor, message.luminance, message.dlog_dt, start + i, at_end + wp.int64(i), stride, count,
                        state,
                    )  # fmt: skip
                else:
                    active[0] = active[0] + 1
                    active[active[0]] = i
                    fetch(rare, start + i)
                i += 1
                place_in_run += 1

    return list_row


@lru_cache
def make_sense_rows(features: Features) -> Any:
    """Makes the kernel `sense_rows` with just these features."""
    sense_pixel, list_row = make_sense_pixel(features, crossings_at_once(features.curved)), make_list_row(features)
    looks_on, straight = features.crossing == "cubic", features.range_decides

    @wp.kernel(module="unique", enable_backward=False)
    def sense_rows(
        # in
        sensor: Sensor,
        begin: wp.array(dtype=wp.int32),
        luminance: wp.array(dtype=wp.float32),
        dlog_dt: wp.array(dtype=wp.float32),
        frames: wp.int32,
        count: wp.int32,
        t: wp.array(dtype=wp.int64),
        t_base: wp.int64,
        t_before: wp.int64,
        episodes: wp.array2d(dtype=wp.int32),
        between: Between,
        luminance_runs: wp.array(dtype=Run),
        slope_runs: wp.array(dtype=Run),
        resume: wp.int32,
        # in and out
        state: FrequentState,
        side: wp.array(dtype=wp.int32),
        active: wp.array(dtype=wp.int32),
        # out
        rare: wp.array2d(dtype=Rare),
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        """Senses a row per thread: threads run one after the other, so that events come in the order of pixels."""
        env, y = wp.tid()
        if counters[LEFT] != wp.int64(0):
            return
        message = message_of(luminance, dlog_dt, frames, count, t, t_base, t_before, episodes, between)
        row = sensor.width * sensor.channels
        size = sensor.height * row
        start = env * size + y * row
        at_first = wp.int64(env) * wp.int64(frames) * wp.int64(size) + wp.int64(y * row)
        # Environments that begin here have no range yet, and a cubic without the frame after has another curve.
        whole = begin[env] == 0 and not (wp.static(looks_on) and frames == count)
        # First the pixels to which something may happen are listed, so that what is kept of them can be on its way.
        j = int(0)
        going_on = resume - 1 - start
        if resume > 0 and going_on >= row:
            return
        if resume > 0 and going_on >= 0:
            while active[j + 1] < going_on:
                j += 1
        elif wp.static(straight) and whole:
            list_active_row(
                luminance, at_first, wp.int64(size), count, t[count - 1], state, start, row, rare, between.first,
                between.shared, active,
            )  # fmt: skip
        else:
            list_row(
                sensor, message, luminance_runs, slope_runs, start, row, at_first, wp.int64(size), whole, state, rare,
                active,
            )  # fmt: skip
        while j < active[0]:
            i = active[j + 1]
            kept = saved(counters)
            place = place_of(sensor, env, y, i // sensor.channels, i % sensor.channels)
            sense_pixel(sensor, place, begin[env], message, state, side, state, side, rare, keys, counters)
            if left_over(sensor, kept, start + i, counters):
                return
            j += 1

    return sense_rows
