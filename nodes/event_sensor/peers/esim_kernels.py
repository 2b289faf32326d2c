"""Computes ESIM's events; the rules are named in esim.py."""

import warp as wp

from nodes.event_sensor.peers.kernels import NEVER, Frame, light_seen, put, random_state

wp.set_module_options({"enable_backward": False})


@wp.struct
class EsimPixel:
    """Keeps what ESIM knows of a pixel.

    log: ln I of the frame before. fired: stamp of the last event [ns]. begun: 0 before an episode's first sample.
    """

    log: wp.float32
    reference: wp.float32
    fired: wp.int64
    begun: wp.int32


@wp.struct
class EsimSensor:
    """Holds ESIM's parameters: thresholds and their spread in ln I, dark in units of luminance, refractory in ns."""

    threshold_on: wp.float32
    threshold_off: wp.float32
    mismatch: wp.float32
    floor: wp.float32
    dark: wp.float32
    refractory: wp.int64


@wp.func
def esim_events(
    frame: Frame,
    sensor: EsimSensor,
    env: wp.int32,
    pixel: wp.int32,
    v: wp.float32,
    p: EsimPixel,
    keys: wp.array(dtype=wp.int64),
    counters: wp.array(dtype=wp.int64),
):
    """Writes a pixel's events of a frame; returns its state after it. The rules are those of esim.py.

    Args:
        frame: which frame.
        sensor: parameters of the model.
        env, pixel: the pixel's environment, and its number there.
        v: luminance, finite and not negative.
        p: state of the pixel before the frame; begun is 0 at an episode's first sample.
        keys, counters: the list of events, and how many there are.
    """
    now = wp.log(light_seen(v, sensor.dark))
    if p.begun == 0:
        p.reference = now
        p.fired = NEVER
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
    return p
