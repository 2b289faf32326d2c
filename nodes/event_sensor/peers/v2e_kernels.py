# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Computes v2e's events; the rules are named in v2e.py."""

import warp as wp

from nodes.event_sensor.peers.kernels import NEVER, Frame, light_seen, put, random_state, sample_at, usable

wp.set_module_options({"enable_backward": False})


@wp.struct
class V2ePixel:
    """Keeps what v2e knows of a pixel.

    photo: output of the photoreceptor, NaN before the first frame. base: what the change detector remembers. fired:
    stamp of the last event [ns].
    """

    photo: wp.float32
    base: wp.float32
    fired: wp.int64


@wp.struct
class V2eSensor:
    """Holds v2e's parameters. Rates in Hz, tau in s, refractory in ns; dn: 8-bit numbers per unit of luminance."""

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
    """Computes the lin-log of an 8-bit number: linear up to 20, logarithmic above, rounded to 1e-8."""
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
    """Computes photoreceptor, leak, and how many thresholds each pixel crosses; draws its noise events.

    Args:
        frame: which frame.
        sensor: parameters of the model.
        images: luminance, float32 [E, K, H, W] flat.
        fresh: int32 [E], not 0 where an episode begins.
        on, off: thresholds per pixel [ln I].
        spread: factor of the leak rate per pixel.
        state: of every pixel; changed in place.
        crossings: thresholds crossed, with their sign, per pixel.
        shots: noise events per pixel: 1 for ON, 2 for OFF, 3 for both.
        busiest: the most crossings of a pixel, per environment.
        counters: samples that are not usable are counted.
    """
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
            level = wp.float32(wp.log(wp.float64(light_seen(v, sensor.dark))))
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
    """Writes the events of every pixel, on the grid of the busiest one, and its state after them.

    Args:
        frame, sensor, on, off, crossings, shots, busiest: as in v2e_levels.
        before, after: state of every pixel before and after the events.
        keys, counters: the list of events, and how many there are.
    """
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
