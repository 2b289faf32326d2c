# ruff: noqa: RUF046, UP018 - int(0) is how a Warp kernel declares a variable that changes
"""The ideal sensor: straight lines in L between frames, no fault. What others pay for is not in this kernel."""

from functools import lru_cache
from typing import Any

import warp as wp

from nodes.event_sensor.kernels import (
    EVENTS,
    GUARD,
    LARGEST,
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
def plain_kernels(frame: bool) -> tuple[Any, Any]:
    """(kernel over rows, kernel over pixels). frame: events carry the stamp of their frame, not of their crossing."""

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
        before: wp.array(dtype=Pixel),
        # out
        after: wp.array(dtype=Pixel),
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
        pixel = before[index]
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
        after[index] = pixel

    @wp.kernel(module="unique")
    def sense_rows(
        # in
        sensor: Sensor,
        luminance: wp.array(dtype=wp.float32),
        t: wp.array(dtype=wp.int64),
        t_base: wp.int64,
        fresh: wp.array(dtype=wp.int32),
        before: wp.array(dtype=Pixel),
        # out
        after: wp.array(dtype=Pixel),
        base: wp.array(dtype=wp.float64),
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        """One row per thread: on a CPU, where threads run one after the other, events come in the order of pixels."""
        env, y = wp.tid()
        x = int(0)
        while x < sensor.width:
            c = int(0)
            while c < sensor.channels:
                sense(sensor, env, y, x, c, fresh[env], luminance, t, t_base, before, after, base, keys, counters)
                c += 1
            x += 1

    @wp.kernel(module="unique")
    def sense_pixels(
        # in
        sensor: Sensor,
        luminance: wp.array(dtype=wp.float32),
        t: wp.array(dtype=wp.int64),
        t_base: wp.int64,
        fresh: wp.array(dtype=wp.int32),
        before: wp.array(dtype=Pixel),
        # out
        after: wp.array(dtype=Pixel),
        base: wp.array(dtype=wp.float64),
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        """One pixel and channel per thread, for a GPU; keys come out in any order and are sorted afterwards."""
        env, y, column = wp.tid()
        x = column // sensor.channels
        c = column % sensor.channels
        sense(sensor, env, y, x, c, fresh[env], luminance, t, t_base, before, after, base, keys, counters)

    return sense_rows, sense_pixels
