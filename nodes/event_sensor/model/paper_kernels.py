# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Computes events by the paper's equations as they stand, for comparison.

n = floor(|L - L_ref| / C) events of one polarity per step, all at the frame's stamp; L_ref moves by n C. Leak, shot
noise and hot pixels fire with probability rate x step, at most once a step, and leave L_ref alone. An event is
suppressed while t - t_last is less than the refractory period, so that of several events of a step the first remains;
L_ref moves anyway.

A signal that returns to its old value stands exactly at a threshold here, where the last bit of L decides about an
event. So that all devices agree, the logarithm is made of operations whose rounding is prescribed, and no product is
contracted with a sum.
"""

import warp as wp

from evis.random_number_kernels import draw, mix, uniform
from nodes.event_sensor.model.faults.random_kernels import stream_of
from nodes.event_sensor.model.key_kernels import key_head, key_tail, key_time, with_mark
from nodes.event_sensor.model.sensor_kernels import (
    DROPPED,
    EVENTS,
    NONFINITE,
    Sensor,
    count_clipped,
    has_level,
    light_seen,
)
from nodes.event_sensor.model.threshold_kernels import thresholds_crossed

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

LN2_HIGH = wp.constant(wp.float64(0.6931471803691238))
"""32 bits of ln 2, so that its product with an exponent is exact."""
LN2_LOW = wp.constant(wp.float64(1.9082149292705877e-10))
ROOT2 = wp.constant(wp.float64(1.4142135623730951))
MANTISSA = wp.constant(wp.int64((1 << 52) - 1))
ONE = wp.constant(wp.int64(1023 << 52))
"""Bits of 1.0."""
TERMS = 12


@wp.struct
class PaperPixel:
    """Holds the reference (NaN: none yet), the stamps of the last event and of the episode's first good sample, and
    the light that is held where a sample is bad."""

    reference: wp.float64
    t_last: wp.int64
    origin: wp.int64
    last: wp.float32
    fired: wp.int32


@wp.func
def ln_as_prescribed(x: wp.float64):
    """Computes ln x = e ln 2 + 2 artanh((m - 1) / (m + 1)) with x = m 2^e, of a positive, normal number.

    To 2 units in the last place: the series of artanh(s), |s| < 0.172, is cut where it is below 1e-19. Why it is not
    the logarithm of sensor_kernels.log_level stands there.
    """
    bits = wp.cast(x, wp.int64)
    e = (bits >> wp.int64(52)) - wp.int64(1023)
    m = wp.cast((bits & MANTISSA) | ONE, wp.float64)
    if m > ROOT2:
        m = m * wp.float64(0.5)
        e += wp.int64(1)
    s = (m - wp.float64(1.0)) / (m + wp.float64(1.0))
    z = s * s
    rest = wp.float64(0.0)
    for i in range(wp.static(TERMS)):
        rest = (rest + wp.float64(wp.static(2.0 / (2 * (TERMS - i) + 1)))) * z
    return wp.float64(e) * LN2_HIGH + (s * rest + (wp.float64(e) * LN2_LOW + wp.float64(2.0) * s))


@wp.func
def fire(
    sensor: Sensor,
    pixel: PaperPixel,
    now: wp.int64,
    key: wp.int64,
    n: wp.int32,
    written: wp.int32,
    keys: wp.array(dtype=wp.int64),
    counters: wp.array(dtype=wp.int64),
    noise: wp.bool,
):
    """Writes those of n events at `now` that the refractory period leaves; returns how many.

    written: events of this pixel in this step so far. noise: whether they are, for a sensor that marks its events.
    """
    event = key
    if sensor.shift_x > wp.int64(3):
        event = with_mark(key, noise)
    left = n
    if n > 0 and sensor.refractory_ns > wp.int64(0):
        left = 1
        if pixel.fired != 0 and now - pixel.t_last < sensor.refractory_ns:
            left = 0
    j = int(0)
    while j < left:
        if sensor.event_cap > 0 and written + j >= sensor.event_cap:
            wp.atomic_add(counters, DROPPED, wp.int64(1))
        else:
            slot = wp.atomic_add(counters, EVENTS, wp.int64(1))
            if slot < sensor.capacity:
                keys[slot] = event
        j += 1
    return left


@wp.func
def sense_paper(
    # in
    sensor: Sensor,
    env: wp.int32,
    y: wp.int32,
    x: wp.int32,
    c: wp.int32,
    begin: wp.int32,
    episode: wp.int32,
    luminance: wp.array(dtype=wp.float32),
    t: wp.array(dtype=wp.int64),
    t_base: wp.int64,
    thresholds_on: wp.array(dtype=wp.float32),
    thresholds_off: wp.array(dtype=wp.float32),
    leak_rates: wp.array(dtype=wp.float32),
    hot_rates: wp.array(dtype=wp.float32),
    before: wp.array(dtype=PaperPixel),
    # out
    after: wp.array(dtype=PaperPixel),
    keys: wp.array(dtype=wp.int64),
    counters: wp.array(dtype=wp.int64),
):
    """Takes one pixel through all steps of a message."""
    count = t.shape[0]
    size = sensor.height * sensor.width * sensor.channels
    inner = (y * sensor.width + x) * sensor.channels + c
    index = env * size + inner
    first = wp.int64(env) * wp.int64(count) * wp.int64(size) + wp.int64(inner)
    pixel = before[index]
    if begin != 0:
        pixel.reference = wp.float64(wp.nan)
        pixel.fired = 0
    c_on = sensor.threshold_on
    c_off = sensor.threshold_off
    if thresholds_on.shape[0] > 0:
        c_on = wp.float64(thresholds_on[index])
        c_off = wp.float64(thresholds_off[index])
    hot = wp.float64(0.0)
    if hot_rates.shape[0] > 0:
        hot = wp.float64(hot_rates[index])
    leak = wp.float64(0.0)
    if leak_rates.shape[0] > 0:
        leak = wp.float64(leak_rates[index])
    noisy = hot + leak + sensor.shot_rate > wp.float64(0.0)
    stream = stream_of(sensor.seed + wp.int64(env), inner, episode)
    start = t_base
    k = int(0)
    while k < count:
        v = luminance[first + wp.int64(k) * wp.int64(size)]
        now = t[k]
        ok = has_level(sensor, v)
        if not ok:
            wp.atomic_add(counters, NONFINITE, wp.int64(1))
        if wp.isnan(pixel.reference):
            if ok:
                pixel.reference = ln_as_prescribed(light_seen(sensor, v))
                pixel.origin = now
                pixel.last = v
                count_clipped(sensor, v, counters)
        else:
            head = key_head(sensor, env) | key_time(sensor, now - t_base)
            written = int(0)
            if ok:
                pixel.last = v
                count_clipped(sensor, v, counters)
                delta = ln_as_prescribed(light_seen(sensor, v)) - pixel.reference
                on = delta > wp.float64(0.0)
                n, signed = thresholds_crossed(delta, c_on, c_off, wp.float64(0.0))
                pixel.reference = pixel.reference + signed * wp.float64(n)
                key = head | key_tail(sensor, y, x, c, on)
                left = fire(sensor, pixel, now, key, n, written, keys, counters, False)
                if left > 0:
                    written += left
                    pixel.t_last = now
                    pixel.fired = 1
            if noisy:
                dt = wp.float64(now - start) * wp.float64(1.0e-9)
                seen = wp.clamp(wp.float64(pixel.last) / sensor.shot_white, wp.float64(0.0), wp.float64(1.0))
                bits = mix(stream ^ mix(wp.uint64(now - pixel.origin)))
                kind = int(0)
                while kind < 3:
                    rate = leak
                    if kind == 1:
                        rate = sensor.shot_rate * (wp.float64(1.0) - seen)
                    if kind == 2:
                        rate = hot
                    chance = draw(bits, wp.int64(kind))
                    if uniform(chance) < rate * dt:
                        on = kind == 0 or (mix(chance) & wp.uint64(1)) != wp.uint64(0)
                        key = head | key_tail(sensor, y, x, c, on)
                        left = fire(sensor, pixel, now, key, 1, written, keys, counters, True)
                        if left > 0:
                            written += left
                            pixel.t_last = now
                            pixel.fired = 1
                    kind += 1
        start = now
        k += 1
    after[index] = pixel


@wp.kernel
def paper(
    # in
    sensor: Sensor,
    begin: wp.array(dtype=wp.int32),
    episodes: wp.array2d(dtype=wp.int32),
    luminance: wp.array(dtype=wp.float32),
    t: wp.array(dtype=wp.int64),
    t_base: wp.int64,
    columns: wp.int32,
    thresholds_on: wp.array(dtype=wp.float32),
    thresholds_off: wp.array(dtype=wp.float32),
    leak_rates: wp.array(dtype=wp.float32),
    hot_rates: wp.array(dtype=wp.float32),
    before: wp.array(dtype=PaperPixel),
    # out
    after: wp.array(dtype=PaperPixel),
    keys: wp.array(dtype=wp.int64),
    counters: wp.array(dtype=wp.int64),
):
    """Senses `columns` pixels and channels of a row per thread: all of them on a CPU, one on a GPU."""
    env, y, group = wp.tid()
    column = group * columns
    end = column + columns
    while column < end:
        sense_paper(
            sensor, env, y, column // sensor.channels, column % sensor.channels, begin[env], episodes[0, env],
            luminance, t, t_base, thresholds_on, thresholds_off, leak_rates, hot_rates, before, after, keys, counters,
        )  # fmt: skip
        column += 1
