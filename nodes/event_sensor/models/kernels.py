# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Kernels of the published event models; the equations are named in each model's file."""

import warp as wp

from nodes.event_sensor.kernels import EVENTS, LARGEST, NONFINITE

wp.set_module_options({"enable_backward": False})

TINY = wp.constant(1.0e-30)
"""Least intensity of which a logarithm is taken."""
NEVER = wp.constant(wp.int64(-(1 << 62)))
"""Stamp of the last event of a pixel that has had none."""


@wp.struct
class Frame:
    """Which frame of which call: `before` is the stamp of the frame before it, `span` the time since [ns]."""

    k: wp.int32
    count: wp.int32
    pixels: wp.int32
    seed: wp.int32
    number: wp.int32
    t_base: wp.int64
    before: wp.int64
    span: wp.int64
    shift_t: wp.int64
    shift_env: wp.int64


@wp.func
def sample_at(frame: Frame, images: wp.array(dtype=wp.float32), env: wp.int32, pixel: wp.int32):
    """Luminance of a pixel in this frame."""
    plane = wp.int64(env) * wp.int64(frame.count) + wp.int64(frame.k)
    return images[plane * wp.int64(frame.pixels) + wp.int64(pixel)]


@wp.func
def usable(intensity: wp.float32, counters: wp.array(dtype=wp.int64)):
    """Whether a sample is finite and not negative; counted if it is not."""
    good = intensity >= 0.0 and intensity <= LARGEST
    if not good:
        wp.atomic_add(counters, NONFINITE, wp.int64(1))
    return good


@wp.func
def random_state(frame: Frame, env: wp.int32, pixel: wp.int32, purpose: wp.int32):
    """Start of the stream of (seed + env, pixel, frame, purpose); purpose < 4."""
    mine = wp.rand_init(frame.seed + env, pixel)
    return wp.rand_init(wp.int32(mine), frame.number * 4 + purpose)


@wp.func
def put(
    frame: Frame,
    env: wp.int32,
    pixel: wp.int32,
    on: wp.bool,
    offset: wp.int64,
    keys: wp.array(dtype=wp.int64),
    counters: wp.array(dtype=wp.int64),
):
    """One event, `offset` ns after the frame before; counted even where it does not fit."""
    slot = wp.atomic_add(counters, EVENTS, wp.int64(1))
    if slot < wp.int64(keys.shape[0]):
        t = frame.before - frame.t_base + wp.clamp(offset, wp.int64(1), frame.span)
        key = (wp.int64(env) << frame.shift_env) | (t << frame.shift_t) | (wp.int64(pixel) << wp.int64(1))
        keys[slot] = key | wp.where(on, wp.int64(1), wp.int64(0))


@wp.struct
class EsimPixel:
    """log: ln I of the frame before, NaN before the first. fired: stamp of the last event [ns]."""

    log: wp.float32
    reference: wp.float32
    fired: wp.int64


@wp.struct
class EsimSensor:
    """Parameters."""

    threshold_on: wp.float32
    threshold_off: wp.float32
    mismatch: wp.float32
    floor: wp.float32
    dark: wp.float32
    refractory: wp.int64


@wp.kernel
def esim(
    # in
    frame: Frame,
    sensor: EsimSensor,
    images: wp.array(dtype=wp.float32),
    fresh: wp.array(dtype=wp.int32),
    before: wp.array(dtype=EsimPixel),
    # out
    after: wp.array(dtype=EsimPixel),
    keys: wp.array(dtype=wp.int64),
    counters: wp.array(dtype=wp.int64),
):
    index = wp.tid()
    env = index // frame.pixels
    pixel = index % frame.pixels
    p = before[index]
    if fresh[env] != 0:
        p.log = float(wp.nan)
        p.fired = NEVER
    v = sample_at(frame, images, env, pixel)
    if usable(v, counters):
        now = wp.log(wp.max(v + sensor.dark, TINY))
        if wp.isnan(p.log):
            p.reference = now
        elif wp.abs(now - p.log) > 1.0e-6:
            on = now >= p.log
            threshold = wp.where(on, sensor.threshold_on, sensor.threshold_off)
            if sensor.mismatch > 0.0:
                draw = random_state(frame, env, pixel, 0)
                threshold = wp.max(threshold + sensor.mismatch * wp.randn(draw), sensor.floor)
            step = wp.where(on, threshold, -threshold)
            rate = wp.float64(frame.span) / wp.float64(now - p.log)
            level = float(p.reference + step)
            while (on and level > p.log and level <= now) or ((not on) and level < p.log and level >= now):
                offset = wp.int64(wp.float64(level - p.log) * rate + wp.float64(0.5))
                stamp = frame.before + offset
                if p.fired == NEVER or stamp - p.fired >= sensor.refractory:
                    put(frame, env, pixel, on, offset, keys, counters)
                    p.fired = stamp
                p.reference = level
                level = level + step
        p.log = now
    after[index] = p


@wp.struct
class V2ePixel:
    """photo: output of the photoreceptor, NaN before the first frame; base: what the change detector remembers."""

    photo: wp.float32
    base: wp.float32
    fired: wp.int64


@wp.struct
class V2eSensor:
    """Parameters. Rates in Hz, times in s unless named ns; dn: 8-bit numbers per unit of luminance."""

    threshold_on: wp.float32
    threshold_off: wp.float32
    dark: wp.float32
    linlog: wp.int32
    dn: wp.float32
    tau: wp.float32
    leak_rate: wp.float32
    leak_jitter: wp.float32
    shot_rate: wp.float32
    refractory: wp.int64


@wp.func
def linlog(dn: wp.float64):
    """Linear up to 20, logarithmic above, rounded to 1e-8."""
    knee = wp.float64(20.0)
    y = wp.where(dn <= knee, dn * wp.log(knee) / knee, wp.log(wp.max(dn, knee)))
    return wp.float32(wp.round(y * wp.float64(1.0e8)) / wp.float64(1.0e8))


@wp.kernel
def v2e_levels(
    # in
    frame: Frame,
    sensor: V2eSensor,
    images: wp.array(dtype=wp.float32),
    fresh: wp.array(dtype=wp.int32),
    on: wp.array(dtype=wp.float32),
    off: wp.array(dtype=wp.float32),
    spread: wp.array(dtype=wp.float32),
    # in and out
    state: wp.array(dtype=V2ePixel),
    # out
    crossings: wp.array(dtype=wp.int32),
    shots: wp.array(dtype=wp.int32),
    busiest: wp.array(dtype=wp.int32),
    counters: wp.array(dtype=wp.int64),
):
    """Photoreceptor, leak, signed number of thresholds crossed, noise events; the most crossings of any pixel."""
    index = wp.tid()
    env = index // frame.pixels
    pixel = index % frame.pixels
    p = state[index]
    if fresh[env] != 0:
        p.photo = float(wp.nan)
        p.fired = NEVER
    crossings[index] = 0
    shots[index] = 0
    v = sample_at(frame, images, env, pixel)
    if usable(v, counters):
        dn = wp.min(v * sensor.dn, 255.0)
        bright = (dn + 20.0) / 275.0
        level = float(0.0)
        if sensor.linlog != 0:
            level = linlog(wp.float64(dn))
        else:
            level = wp.float32(wp.log(wp.float64(wp.max(v + sensor.dark, TINY))))
        if wp.isnan(p.photo):
            p.photo = level
            p.base = level
        else:
            dt = wp.float32(wp.float64(frame.span) * wp.float64(1.0e-9))
            if sensor.tau > 0.0:
                eps = wp.min(bright * dt / sensor.tau, 1.0)
                p.photo = (1.0 - eps) * p.photo + eps * level
            else:
                p.photo = level
            if sensor.leak_rate > 0.0:
                draw = random_state(frame, env, pixel, 0)
                rate = sensor.leak_rate * spread[index] * (1.0 - sensor.leak_jitter * wp.randn(draw))
                p.base = p.base - dt * rate * on[index]
            delta = p.photo - p.base
            n = wp.int32(wp.max(delta, 0.0) / on[index]) - wp.int32(wp.max(-delta, 0.0) / off[index])
            crossings[index] = n
            wp.atomic_max(busiest, env, wp.abs(n))
            if sensor.shot_rate > 0.0:
                u = wp.randf(random_state(frame, env, pixel, 1))
                half = 0.5 * sensor.shot_rate * dt * (1.0 - 0.75 * bright)
                shot_on = u > 1.0 - half * sensor.threshold_on / on[index]
                shot_off = u < half * sensor.threshold_off / off[index]
                shots[index] = wp.where(shot_on, 1, 0) + wp.where(shot_off, 2, 0)
    state[index] = p


@wp.kernel
def v2e_emit(
    # in
    frame: Frame,
    sensor: V2eSensor,
    on: wp.array(dtype=wp.float32),
    off: wp.array(dtype=wp.float32),
    crossings: wp.array(dtype=wp.int32),
    shots: wp.array(dtype=wp.int32),
    busiest: wp.array(dtype=wp.int32),
    before: wp.array(dtype=V2ePixel),
    # out
    after: wp.array(dtype=V2ePixel),
    keys: wp.array(dtype=wp.int64),
    counters: wp.array(dtype=wp.int64),
):
    index = wp.tid()
    env = index // frame.pixels
    pixel = index % frame.pixels
    p = before[index]
    steps = wp.max(busiest[env], 1)
    step = wp.float64(frame.span) / wp.float64(steps)
    n = crossings[index]
    up = n > 0
    threshold = wp.where(up, on[index], -off[index])
    # A dead time within one step of the grid is not looked at.
    dead = wp.where(wp.float64(sensor.refractory) > step, sensor.refractory, wp.int64(0))
    i = int(0)
    fired = int(0)
    while i < wp.abs(n):
        offset = wp.int64(wp.float64(i + 1) * step + wp.float64(0.5))
        stamp = frame.before + offset
        if dead == wp.int64(0) or p.fired == NEVER or stamp - p.fired > dead:
            put(frame, env, pixel, up, offset, keys, counters)
            p.fired = stamp
            fired += 1
        i += 1
    p.base = p.base + wp.float32(fired) * threshold
    shot = shots[index]
    if shot != 0:
        if (shot & 1) != 0:
            put(frame, env, pixel, True, frame.span, keys, counters)
        if (shot & 2) != 0:
            put(frame, env, pixel, False, frame.span, keys, counters)
        p.base = p.photo
    after[index] = p


@wp.struct
class VoltPixel:
    """light: luminance of the frame before [DN], NaN before the first; residual: voltage since the last event."""

    light: wp.float64
    residual: wp.float64


@wp.struct
class VoltSensor:
    """Parameters k1 to k6 (times in us, luminance in DN), the OFF threshold in units of the ON threshold."""

    k1: wp.float64
    k2: wp.float64
    k3: wp.float64
    k4: wp.float64
    k5: wp.float64
    k6: wp.float64
    off: wp.float64
    dn: wp.float64


@wp.func
def expm1(x: wp.float64):
    """exp(x) - 1 without cancellation."""
    small = x * (wp.float64(1.0) + x * (wp.float64(0.5) + x * (wp.float64(1.0 / 6.0) + x * wp.float64(1.0 / 24.0))))
    return wp.where(wp.abs(x) < wp.float64(1.0e-3), small, wp.exp(x) - wp.float64(1.0))


@wp.func
def first_on(drift: wp.float64, sigma: wp.float64, up: wp.float64, down: wp.float64):
    """Probability that Brownian motion from 0 reaches `up` before `-down`."""
    x = wp.float64(2.0) * drift / (sigma * sigma)
    result = down / (up + down)
    if x > wp.float64(0.0):
        result = expm1(-x * down) / expm1(-x * (up + down))
    elif x < wp.float64(0.0):
        result = wp.exp(x * up) * expm1(x * down) / expm1(x * (up + down))
    return result


@wp.func
def passage(distance: wp.float64, drift: wp.float64, sigma: wp.float64, z: wp.float64, u: wp.float64):
    """A sample of the first passage time: inverse Gaussian of mean distance / drift and shape (distance / sigma)^2."""
    scale = distance / sigma
    result = scale * scale / wp.max(z * z, wp.float64(1.0e-12))
    if drift > wp.float64(0.0):
        mean = distance / drift
        w = mean * z * z / (wp.float64(2.0) * scale * scale)
        root = mean / (wp.float64(1.0) + w + wp.sqrt(w * (w + wp.float64(2.0))))
        result = wp.where(u * (mean + root) <= mean, root, mean * mean / wp.max(root, wp.float64(1.0e-300)))
    return result


@wp.kernel
def dvs_voltmeter(
    # in
    frame: Frame,
    sensor: VoltSensor,
    images: wp.array(dtype=wp.float32),
    fresh: wp.array(dtype=wp.int32),
    before: wp.array(dtype=VoltPixel),
    # out
    after: wp.array(dtype=VoltPixel),
    keys: wp.array(dtype=wp.int64),
    counters: wp.array(dtype=wp.int64),
):
    index = wp.tid()
    env = index // frame.pixels
    pixel = index % frame.pixels
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    p = before[index]
    if fresh[env] != 0:
        p.light = wp.float64(wp.nan)
        p.residual = zero
    v = sample_at(frame, images, env, pixel)
    if usable(v, counters):
        light = wp.float64(v) * sensor.dn
        if not wp.isnan(p.light):
            end = wp.float64(frame.span) * wp.float64(1.0e-3)
            mean = wp.float64(0.5) * (light + p.light)
            inverse = one / wp.max(mean + sensor.k2, wp.float64(1.0e-30))
            drift = sensor.k1 * (light - p.light) / end * inverse + sensor.k4 + sensor.k5 * mean
            sigma = sensor.k3 * wp.sqrt(mean) * inverse + sensor.k6
            draws = random_state(frame, env, pixel, 0)
            now = wp.float64(0.0)
            while now < end and (drift != zero or sigma > zero):
                up = wp.max(one - p.residual, wp.float64(1.0e-9))
                down = wp.max(sensor.off + p.residual, wp.float64(1.0e-9))
                on = drift > zero
                wait = wp.float64(0.0)
                if sigma > zero:
                    on = wp.float64(wp.randf(draws)) < first_on(drift, sigma, up, down)
                    z = wp.float64(wp.randn(draws))
                    u = wp.float64(wp.randf(draws))
                    wait = passage(wp.where(on, up, down), wp.abs(drift), sigma, z, u)
                else:
                    wait = wp.where(on, up, down) / wp.abs(drift)
                wait = wp.max(wait, wp.float64(1.0e-3))
                reached = wp.where(on, up, -down)
                if now + wait < end:
                    now = now + wait
                    p.residual = zero
                    put(frame, env, pixel, on, wp.int64(now * wp.float64(1.0e3) + wp.float64(0.5)), keys, counters)
                else:
                    p.residual = p.residual + reached * (end - now) / wait
                    now = end
        p.light = light
    after[index] = p
