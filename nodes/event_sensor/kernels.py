# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Kernels of the event sensor: crossings of log-luminance, the order of events, defocus.

What decides about an event is computed in float64 from float32 intensities and whole numbers of thresholds; no float is
carried from step to step, so nothing drifts and the result does not depend on how frames are cut into messages.

Inner loops are `while`: Warp's `range` costs 1.5 ns per turn on a CPU, a `while` 0.1 ns.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

TOLERANCE = wp.constant(wp.float64(2.0**-23))
"""A crossing missed by less than this in ln I counts as reached: the rounding of a float32 luminance."""
GUARD = wp.constant(1.0e-5)
"""Relative width by which the quiet band is narrowed, above all float32 errors in it (exp of |L| < 90: 8e-6)."""
LARGEST = wp.constant(3.4028235e38)


@wp.struct
class Pixel:
    """State of one pixel and channel. Intensities in [low, high] cannot fire; low infinite: no reference yet."""

    last: wp.float32
    low: wp.float32
    high: wp.float32
    n_on: wp.int32
    n_off: wp.int32


@wp.struct
class Sensor:
    """Parameters. Thresholds in ln I; dark and floor in radiance units; the shifts lay out a key."""

    threshold_on: wp.float64
    threshold_off: wp.float64
    gain_on: wp.float32  # exp(threshold_on)
    gain_off: wp.float32  # exp(-threshold_off)
    dark: wp.float64
    floor: wp.float32  # least value of I + dark
    height: wp.int32
    width: wp.int32
    channels: wp.int32
    capacity: wp.int64
    shift_x: wp.int64
    shift_y: wp.int64
    shift_t: wp.int64
    shift_env: wp.int64


@wp.func
def log_level(sensor: Sensor, intensity: wp.float32):
    """L = ln(I + I_dark)."""
    level = wp.float64(intensity) + sensor.dark
    return wp.log(wp.max(level, wp.float64(sensor.floor)))


@wp.func
def valid(intensity: wp.float32):
    """Finite and not negative; false for NaN."""
    return intensity >= 0.0 and intensity <= LARGEST


@wp.func
def count_clipped(sensor: Sensor, intensity: wp.float32, counters: wp.array(dtype=wp.int64)):
    if wp.float64(intensity) + sensor.dark < wp.float64(sensor.floor):
        wp.atomic_add(counters, 2, wp.int64(1))


@wp.func
def quiet_band(sensor: Sensor, reference: wp.float64, pixel: Pixel):
    """The pixel with the band of intensities that surely stay below both thresholds of this reference."""
    level = wp.exp(wp.float32(reference))
    dark = wp.float32(sensor.dark)
    low = level * sensor.gain_off * (1.0 + GUARD)
    # Nothing lies below the floor, so a pixel resting on it is quiet.
    pixel.low = wp.where(low <= sensor.floor, 0.0, wp.clamp(low - dark, 0.0, LARGEST))
    pixel.high = wp.min(level * sensor.gain_on * (1.0 - GUARD) - dark, LARGEST)
    return pixel


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
    """All steps of one pixel. counters: events, non-finite samples, samples below the floor."""
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
        elif not valid(v):
            # The last good value is held, so the next step starts here and its events are later than this stamp.
            wp.atomic_add(counters, 1, wp.int64(1))
        elif pixel.low > LARGEST:
            level = log_level(sensor, v)
            base[index] = level
            pixel.n_on = 0
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
                + wp.float64(pixel.n_on) * sensor.threshold_on
                - wp.float64(pixel.n_off) * sensor.threshold_off
            )
            delta = l1 - reference
            on = delta > wp.float64(0.0)
            step = wp.where(on, sensor.threshold_on, sensor.threshold_off)
            n = wp.int32((wp.abs(delta) + TOLERANCE) / step)
            if n > 0:
                signed = wp.where(on, step, -step)
                span = t[k] - start
                slope = wp.float64(span) / (l1 - l0)
                head = wp.int64(env) << sensor.shift_env
                tail = (wp.int64(y) << sensor.shift_y) | (wp.int64(x) << sensor.shift_x) | wp.int64(c * 2)
                tail = tail | wp.where(on, wp.int64(1), wp.int64(0))
                slot = wp.atomic_add(counters, 0, wp.int64(n))
                j = int(0)
                while j < n:
                    # L is linear inside the step: t = t0 + (L_j - L_0) / (L_1 - L_0) * (t1 - t0), to the nearest ns.
                    crossing = (reference + wp.float64(j + 1) * signed - l0) * slope
                    ns = wp.int64(wp.clamp(crossing + wp.float64(0.5), wp.float64(1.0), wp.float64(span)))
                    if slot + wp.int64(j) < sensor.capacity:
                        keys[slot + wp.int64(j)] = head | ((start - t_base + ns) << sensor.shift_t) | tail
                    j += 1
                if on:
                    pixel.n_on = pixel.n_on + n
                else:
                    pixel.n_off = pixel.n_off + n
                pixel = quiet_band(sensor, reference + wp.float64(n) * signed, pixel)
            pixel.last = v
            l_last = l1
            known = bool(True)
        start = t[k]
        k += 1
    after[index] = pixel


@wp.kernel
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
    """One row per thread: on a CPU, where threads run one after the other, events come out in the order of pixels."""
    env, y = wp.tid()
    x = int(0)
    while x < sensor.width:
        c = int(0)
        while c < sensor.channels:
            sense(sensor, env, y, x, c, fresh[env], luminance, t, t_base, before, after, base, keys, counters)
            c += 1
        x += 1


@wp.kernel
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


@wp.kernel
def radix_pass(
    # in
    count: wp.int32,
    shift: wp.int64,
    mask: wp.int32,
    source: wp.array(dtype=wp.int64),
    # out
    sorted_keys: wp.array(dtype=wp.int64),
    place: wp.array(dtype=wp.int32),
):
    """One stable counting pass over the digit at `shift`, one serial thread (CPU)."""
    b = int(0)
    while b <= mask:
        place[b] = 0
        b += 1
    i = int(0)
    while i < count:
        digit = wp.int32(source[i] >> shift) & mask
        place[digit] = place[digit] + 1
        i += 1
    total = int(0)
    b = int(0)
    while b <= mask:
        here = place[b]
        place[b] = total
        total = total + here
        b += 1
    i = int(0)
    while i < count:
        key = source[i]
        digit = wp.int32(key >> shift) & mask
        to = place[digit]
        sorted_keys[to] = key
        place[digit] = to + 1

        i += 1


@wp.kernel
def unpack(
    # in
    sensor: Sensor,
    t_base: wp.int64,
    keys: wp.array(dtype=wp.int64),
    # out
    t: wp.array(dtype=wp.int64),
    x: wp.array(dtype=wp.uint16),
    y: wp.array(dtype=wp.uint16),
    p: wp.array(dtype=wp.uint8),
):
    """Keys to columns; the colour channel is read apart, where there is one."""
    i = wp.tid()
    key = keys[i]
    one = wp.int64(1)
    t[i] = t_base + ((key >> sensor.shift_t) & ((one << (sensor.shift_env - sensor.shift_t)) - one))
    y[i] = wp.uint16((key >> sensor.shift_y) & ((one << (sensor.shift_t - sensor.shift_y)) - one))
    x[i] = wp.uint16((key >> sensor.shift_x) & ((one << (sensor.shift_y - sensor.shift_x)) - one))
    p[i] = wp.uint8(key & one)


@wp.kernel
def blur(
    # in
    weights: wp.array(dtype=wp.float32),
    image: wp.array4d(dtype=wp.float32),
    axis: wp.int32,
    # out
    blurred: wp.array4d(dtype=wp.float32),
):
    """One pass of a separable filter along axis 1 or 2 of [N, H, W, C]; the pixels at the edge are repeated."""
    n, y, x, c = wp.tid()
    radius = (weights.shape[0] - 1) // 2
    total = float(0.0)
    for j in range(-radius, radius + 1):
        if axis == 1:
            total += weights[j + radius] * image[n, wp.clamp(y + j, 0, image.shape[1] - 1), x, c]
        else:
            total += weights[j + radius] * image[n, y, wp.clamp(x + j, 0, image.shape[2] - 1), c]
    blurred[n, y, x, c] = total
