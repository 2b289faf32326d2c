"""Computes DVS-Voltmeter's events; the equations are named in dvs_voltmeter.py."""

import warp as wp

from nodes.event_sensor.peers.kernels import Frame, put, random_state

wp.set_module_options({"enable_backward": False})


@wp.struct
class VoltPixel:
    """Keeps what DVS-Voltmeter knows of a pixel.

    light: luminance of the frame before [DN]. residual: voltage since the last event. begun: as in EsimPixel.
    """

    light: wp.float64
    residual: wp.float64
    begun: wp.int32


@wp.struct
class VoltSensor:
    """Holds k1 to k6 (times in us, luminance in DN), `off`, the OFF threshold in units of ON, and DN per luminance."""

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
    """Computes exp(x) - 1 without cancellation."""
    small = x * (wp.float64(1.0) + x * (wp.float64(0.5) + x * (wp.float64(1.0 / 6.0) + x * wp.float64(1.0 / 24.0))))
    return wp.where(wp.abs(x) < wp.float64(1.0e-3), small, wp.exp(x) - wp.float64(1.0))


@wp.func
def first_on(drift: wp.float64, sigma: wp.float64, up: wp.float64, down: wp.float64):
    """Computes the probability that Brownian motion from 0 reaches `up` before `-down`."""
    x = wp.float64(2.0) * drift / (sigma * sigma)
    result = down / (up + down)
    if x > wp.float64(0.0):
        result = expm1(-x * down) / expm1(-x * (up + down))
    elif x < wp.float64(0.0):
        result = wp.exp(x * up) * expm1(x * down) / expm1(x * (up + down))
    return result


@wp.func
def passage(distance: wp.float64, drift: wp.float64, sigma: wp.float64, z: wp.float64, u: wp.float64):
    """Draws a first passage time [us]: inverse Gaussian of mean distance / drift and shape (distance / sigma)^2.

    Michael, Schucany, Haas 1976.

    Args:
        distance: to the threshold, positive.
        drift: of the voltage towards it [1/us]; 0 gives Levy's law.
        sigma: of the Brownian motion [us^-0.5], positive.
        z: a standard normal number.
        u: a uniform number in [0, 1).
    """
    scale = distance / sigma
    result = scale * scale / wp.max(z * z, wp.float64(1.0e-12))
    if drift > wp.float64(0.0):
        mean = distance / drift
        w = mean * z * z / (wp.float64(2.0) * scale * scale)
        root = mean / (wp.float64(1.0) + w + wp.sqrt(w * (w + wp.float64(2.0))))
        result = wp.where(u * (mean + root) <= mean, root, mean * mean / wp.max(root, wp.float64(1.0e-300)))
    return result


@wp.func
def voltmeter_events(
    frame: Frame,
    sensor: VoltSensor,
    env: wp.int32,
    pixel: wp.int32,
    v: wp.float32,
    p: VoltPixel,
    keys: wp.array(dtype=wp.int64),
    counters: wp.array(dtype=wp.int64),
):
    """Writes a pixel's events of a frame; returns its state after it. Equations (10), (11), algorithm 1.

    Args:
        frame: which frame.
        sensor: parameters of the model.
        env, pixel: the pixel's environment, and its number there.
        v: luminance, finite and not negative.
        p: state of the pixel before the frame; begun is 0 at an episode's first sample.
        keys, counters: the list of events, and how many there are.
    """
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    light = wp.float64(v) * sensor.dn
    if p.begun == 0:
        p.residual = zero
    else:
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
    return p
