# ruff: noqa: RUF046, UP018 - int(0) is how a Warp kernel declares a variable that changes
"""The ideal sensor: straight lines in L between frames, no fault. What others pay for is not in this kernel."""

from functools import lru_cache

import warp as wp

from nodes.event_sensor.kernels import (
    EVENTS,
    GUARD,
    LARGEST,
    LEFT,
    NONFINITE,
    TOLERANCE,
    Pixel,
    Sensor,
    count_clipped,
    key_head,
    key_tail,
    least,
    log_level,
    valid,
)
from nodes.event_sensor.kernels_quiet import RUN, Quiet, Run, left_over, quiet_margins, saved

wp.set_module_options({"enable_backward": False})


@wp.func
def quiet_band(sensor: Sensor, reference: wp.float64, pixel: Pixel):
    """The pixel with the band of intensities that surely stay below both thresholds of this reference."""
    level = wp.exp(wp.float32(reference))
    dark = wp.float32(sensor.dark)
    low = level * sensor.gain_off * (1.0 + GUARD)
    # Nothing lies below the floor, so a pixel resting on it is quiet.
    pixel.low = wp.where(low <= sensor.floor, least(sensor), wp.clamp(low - dark, 0.0, LARGEST))
    pixel.high = wp.min(level * sensor.gain_on * (1.0 - GUARD) - dark, LARGEST)
    return pixel


@lru_cache
def plain_kernel(frame: bool) -> wp.Kernel:
    """The kernel, a row a thread. frame: events carry the stamp of their frame, not of their crossing."""

    @wp.func
    def sense(
        # in
        sensor: Sensor,
        env: wp.int32,
        y: wp.int32,
        x: wp.int32,
        c: wp.int32,
        fresh: wp.int32,
        luminance: wp.array(dtype=wp.float32),
        t: wp.array(dtype=wp.int64),
        t_base: wp.int64,
        # out
        quiet: Quiet,
        counts: wp.array(dtype=wp.vec2i),
        base: wp.array(dtype=wp.float64),
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        """All steps of one pixel. Writes its events as keys, and counts."""
        count = t.shape[0]
        size = sensor.height * sensor.width * sensor.channels
        inner = (y * sensor.width + x) * sensor.channels + c
        index = env * size + inner
        at = wp.int64(env) * wp.int64(count) * wp.int64(size) + wp.int64(inner)
        stride = wp.int64(size)
        pixel = Pixel()
        pixel.last = quiet.last[index]
        pixel.low = quiet.low[index]
        pixel.high = quiet.high[index]
        pixel.net = counts[index][0]
        pixel.n_off = counts[index][1]
        if fresh != 0:
            pixel.low = float(wp.inf)
        first = int(0)
        last = pixel.last
        while first < count:
            v = luminance[at + wp.int64(first) * stride]
            if not (v >= pixel.low and v <= pixel.high):
                break
            last = v
            first += 1
        pixel.last = last
        start = t_base
        if first > 0:
            start = t[first - 1]
        l_last = wp.float64(0.0)
        known = bool(False)
        k = int(first)
        while k < count:
            v = luminance[at + wp.int64(k) * stride]
            if v >= pixel.low and v <= pixel.high:
                pixel.last = v
                known = bool(False)
            elif not valid(sensor, v):
                # The last good value is held, so the next step starts here and its events are later than this stamp.
                wp.atomic_add(counters, NONFINITE, wp.int64(1))
            elif pixel.low > LARGEST:
                level = log_level(sensor, v)
                base[index] = level
                pixel.net = 0
                pixel.n_off = 0
                pixel = quiet_band(sensor, level, pixel)
                pixel.last = v
                count_clipped(sensor, v, counters)
            else:
                count_clipped(sensor, v, counters)
                l0 = l_last
                if not known:
                    l0 = log_level(sensor, pixel.last)
                l1 = log_level(sensor, v)
                reference = (
                    base[index]
                    + wp.float64(pixel.net) * sensor.threshold_on
                    + wp.float64(pixel.n_off) * (sensor.threshold_on - sensor.threshold_off)
                )
                delta = l1 - reference
                on = delta > wp.float64(0.0)
                step = wp.where(on, sensor.threshold_on, sensor.threshold_off)
                n = wp.int32((wp.abs(delta) + TOLERANCE) / step)
                if n > 0:
                    signed = wp.where(on, step, -step)
                    span = t[k] - start
                    slope = wp.float64(span) / (l1 - l0)
                    head = key_head(sensor, env)
                    tail = key_tail(sensor, y, x, c, on)
                    slot = wp.atomic_add(counters, EVENTS, wp.int64(n))
                    j = int(0)
                    while j < n:
                        # L is linear inside the step: t = t0 + (L_j - L_0) / (L_1 - L_0) (t1 - t0), to the nearest ns.
                        crossing = (reference + wp.float64(j + 1) * signed - l0) * slope
                        ns = wp.int64(wp.clamp(crossing + wp.float64(0.5), wp.float64(1.0), wp.float64(span)))
                        if wp.static(frame):
                            ns = span
                        if slot + wp.int64(j) < sensor.capacity:
                            keys[slot + wp.int64(j)] = head | ((start - t_base + ns) << sensor.shift_t) | tail
                        j += 1
                    if on:
                        pixel.net = pixel.net + n
                    else:
                        pixel.net = pixel.net - n
                        pixel.n_off = pixel.n_off + n
                    pixel = quiet_band(sensor, reference + wp.float64(n) * signed, pixel)
                pixel.last = v
                l_last = l1
                known = bool(True)
            start = t[k]
            k += 1
        if counters[EVENTS] <= sensor.capacity:
            quiet.last[index] = pixel.last
            quiet.low[index] = pixel.low
            quiet.high[index] = pixel.high
            counts[index] = wp.vec2i(pixel.net, pixel.n_off)

    @wp.kernel(module="unique")
    def sense_rows(
        # in
        sensor: Sensor,
        luminance: wp.array(dtype=wp.float32),
        luminance_runs: wp.array(dtype=Run),
        t: wp.array(dtype=wp.int64),
        t_base: wp.int64,
        fresh: wp.array(dtype=wp.int32),
        resume: wp.int32,
        # in and out
        quiet: Quiet,
        counts: wp.array(dtype=wp.vec2i),
        # out
        base: wp.array(dtype=wp.float64),
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        """One row per thread: on a CPU, where threads run one after the other, events come in the order of pixels."""
        env, y = wp.tid()
        if counters[LEFT] != wp.int64(0):
            return
        count = t.shape[0]
        row = sensor.width * sensor.channels
        size = sensor.height * row
        start = env * size + y * row
        at = wp.int64(env) * wp.int64(count) * wp.int64(size) + wp.int64(y * row)
        end = at + wp.int64(count - 1) * wp.int64(size)
        begins = fresh[env]
        i = wp.max(resume - start, 0)
        margins = Run()
        while i < row:
            lanes = wp.min(row - i, wp.static(RUN))
            if begins == 0 and lanes == wp.static(RUN):
                margins = quiet_margins(quiet, luminance_runs, start + i, at + wp.int64(i), wp.int64(size), count)
                if wp.min(margins) >= 0.0:
                    quiet.last_runs[start + i] = luminance_runs[end + wp.int64(i)]
                    i += wp.static(RUN)
                    continue
            else:
                margins = Run(-1.0)
            lane = int(0)
            while lane < lanes:
                if margins[lane] >= 0.0:
                    quiet.last[start + i] = luminance[end + wp.int64(i)]
                else:
                    kept = saved(counters)
                    sense(
                        sensor, env, y, i // sensor.channels, i % sensor.channels, begins, luminance, t, t_base,
                        quiet, counts, base, keys, counters,
                    )  # fmt: skip
                    if left_over(sensor, kept, start + i, counters):
                        return
                i += 1
                lane += 1

    return sense_rows
