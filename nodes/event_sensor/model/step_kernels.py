"""Defines the structs that the functions of a pixel share: its place, the step, the light in it, how far it has
advanced."""

import warp as wp

from nodes.event_sensor.input.between_kernels import Between
from nodes.event_sensor.model.sensor_kernels import Sensor

wp.set_module_options({"enable_backward": False})


@wp.struct
class Message:
    """Holds the frames of a message, see batch.Batch; [E, frames, H, W, C] flat. The first `count` settle now."""

    luminance: wp.array(dtype=wp.float32)
    dlog_dt: wp.array(dtype=wp.float32)  # d ln I/dt [1/s]; empty but for crossing=hermite
    frames: wp.int32
    count: wp.int32
    t: wp.array(dtype=wp.int64)
    t_base: wp.int64
    t_before: wp.int64
    episodes: wp.array2d(dtype=wp.int32)
    between: Between


@wp.func
def message_of(
    luminance: wp.array(dtype=wp.float32),
    dlog_dt: wp.array(dtype=wp.float32),
    frames: wp.int32,
    count: wp.int32,
    t: wp.array(dtype=wp.int64),
    t_base: wp.int64,
    t_before: wp.int64,
    episodes: wp.array2d(dtype=wp.int32),
    between: Between,
):
    """Makes a Message in a kernel: the host takes 3 us to fill in a field of a struct, as long as a row of pixels."""
    message = Message()
    message.luminance = luminance
    message.dlog_dt = dlog_dt
    message.frames = frames
    message.count = count
    message.t = t
    message.t_base = t_base
    message.t_before = t_before
    message.episodes = episodes
    message.between = between
    return message


@wp.struct
class Place:
    """Locates a pixel and channel: its number in its environment (inner) and among all (index)."""

    env: wp.int32
    y: wp.int32
    x: wp.int32
    c: wp.int32
    inner: wp.int32
    index: wp.int32


@wp.func
def place_of(sensor: Sensor, env: wp.int32, y: wp.int32, x: wp.int32, c: wp.int32):
    """Returns the Place of a pixel and channel."""
    place = Place()
    place.env = env
    place.y = y
    place.x = x
    place.c = c
    place.inner = (y * sensor.width + x) * sensor.channels + c
    place.index = env * (sensor.height * sensor.width * sensor.channels) + place.inner
    return place


@wp.struct
class Sample:
    """Holds the frame at the end of a step and, where its curve needs it, of the one after (following)."""

    light: wp.float32
    slope: wp.float32  # dL/dt [1/s], of hermite
    following: wp.float32
    has_next: wp.bool


@wp.struct
class Step:
    """Describes the time between two samples: from `start` to `now`, h ns; per_h = 1 / h.

    k: the frame of the message that it ends at, or the next one after a further sample.
    """

    k: wp.int32
    start: wp.int64
    now: wp.int64
    h: wp.float64
    per_h: wp.float64


@wp.struct
class Levels:
    """Holds L of the samples earlier, early, last and next of a curve, UNKNOWN_LEVEL where not known.

    moved: |dL| of the last step.
    """

    earlier: wp.float64
    early: wp.float64
    last: wp.float64
    next: wp.float64
    moved: wp.float64


@wp.struct
class Signal:
    """Holds a pixel's signal in a step: the curve S(u), u in [0, 1], L at its end, and the light at both ends."""

    s: wp.vec4d
    l1: wp.float64
    last: wp.float32
    light: wp.float32


@wp.struct
class PixelParameters:
    """Holds what differs from pixel to pixel: thresholds, drift of S by its leak [1/ns], and its noise.

    rate: of the candidates of the noise [Hz]; hot_share: how many of them are those of a hot pixel.
    """

    c_on: wp.float64
    c_off: wp.float64
    drift: wp.float64
    rate: wp.float64
    hot_share: wp.float64


@wp.struct
class StepProgress:
    """Holds how far a pixel has advanced in a step: at place u in [0, 1], the last happening being at `last_time` [ns].

    reference: L_ref there. fired: events so far. leak_event_at: when the Bernoulli leak fires, NEVER
    where it does not or has.
    stream: of the pixel's random numbers, where `stream_known`. key_on, key_off: of its events, but for their time.
    """

    u: wp.float64
    last_time: wp.int64
    reference: wp.float64
    fired: wp.int32
    leak_event_at: wp.int64
    stream: wp.uint64
    stream_known: wp.bool
    key_on: wp.int64
    key_off: wp.int64
