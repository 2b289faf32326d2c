"""Holds what the kernels of the published event models share: a frame, its samples, random numbers, events."""

from functools import cache
from typing import Any

import warp as wp

from nodes.event_sensor.model.sensor_kernels import EVENTS, LARGEST, NONFINITE

wp.set_module_options({"enable_backward": False})

TINY = wp.constant(1.0e-30)
"""Least intensity of which a logarithm is taken."""
NEVER = wp.constant(wp.int64(-(1 << 62)))
"""Stamp of the last event of a pixel that has had none."""


@wp.struct
class Frame:
    """Identifies a frame within a call of a model, with its times and the layout of its events' keys.

    k, count: its place among the frames of the call, and their number. pixels: of an environment. number: of the frame
    since the start. before: stamp of the frame before; span: the time since [ns]. t_base: the call's start [ns].
    shift_t, shift_env: where time and environment begin in a key.
    """

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
    """Returns the luminance of a pixel in this frame."""
    plane = wp.int64(env) * wp.int64(frame.count) + wp.int64(frame.k)
    return images[plane * wp.int64(frame.pixels) + wp.int64(pixel)]


@wp.func
def usable(intensity: wp.float32, counters: wp.array(dtype=wp.int64)):
    """Tells whether a sample is finite and not negative; counts it if it is not."""
    good = intensity >= 0.0 and intensity <= LARGEST
    if not good:
        wp.atomic_add(counters, NONFINITE, wp.int64(1))
    return good


@wp.func
def light_seen(intensity: wp.float32, dark: wp.float32):
    """Computes I + I_dark, of which a model takes the logarithm, or TINY if that is more."""
    return wp.max(intensity + dark, TINY)


@wp.func
def random_state(frame: Frame, env: wp.int32, pixel: wp.int32, purpose: wp.int32):
    """Starts the stream of (seed + env, pixel, frame, purpose); purpose < 4."""
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
    """Writes one event; counts it even where it does not fit.

    Args:
        frame: which frame.
        env, pixel: the pixel's environment, and its number there.
        on: polarity.
        offset: time after the frame before [ns].
        keys, counters: the list of events, and how many there are.
    """
    slot = wp.atomic_add(counters, EVENTS, wp.int64(1))
    if slot < wp.int64(keys.shape[0]):
        t = frame.before - frame.t_base + wp.clamp(offset, wp.int64(1), frame.span)
        key = (wp.int64(env) << frame.shift_env) | (t << frame.shift_t) | (wp.int64(pixel) << wp.int64(1))
        keys[slot] = key | wp.where(on, wp.int64(1), wp.int64(0))


@cache
def each_pixel(step: Any, sensor_type: Any, pixel_type: Any) -> Any:
    """Makes the kernel of one frame of a model that makes a pixel's events in one go.

    step: function of (frame, sensor, env, pixel, v, p, keys, counters) that returns the pixel's state p after a good
    sample v; p.begun is 0 at the first one of an episode. Samples that are not usable change nothing.
    """

    @wp.kernel(module="unique", enable_backward=False)
    def sense(
        # in
        frame: Frame,
        sensor: sensor_type,
        images: wp.array(dtype=wp.float32),
        fresh: wp.array(dtype=wp.int32),
        before: wp.array(dtype=pixel_type),
        # out
        after: wp.array(dtype=pixel_type),
        keys: wp.array(dtype=wp.int64),
        counters: wp.array(dtype=wp.int64),
    ):
        """Senses a pixel per thread.

        Args:
            frame: which frame.
            sensor: parameters of the model.
            images: luminance, float32 [E, K, H, W] flat.
            fresh: int32 [E], not 0 where an episode begins.
            before, after: state of every pixel before and after the frame.
            keys, counters: the list of events, and how many there are.
        """
        index = wp.tid()
        env = index // frame.pixels
        pixel = index % frame.pixels
        p = before[index]
        if fresh[env] != 0:
            p.begun = 0
        v = sample_at(frame, images, env, pixel)
        if usable(v, counters):
            p = step(frame, sensor, env, pixel, v, p, keys, counters)
            p.begun = 1
        after[index] = p

    return sense
