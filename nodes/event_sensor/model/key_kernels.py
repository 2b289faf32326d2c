"""Packs an event into one whole number that sorts, its key, and unpacks it; keys.KeyLayout says where a field
starts."""

import warp as wp

from nodes.event_sensor.model.sensor_kernels import Sensor

wp.set_module_options({"enable_backward": False})


@wp.func
def key_head(sensor: Sensor, env: wp.int32):
    """Returns the part of a key that all events of an environment share."""
    return wp.int64(env) << sensor.shift_env


@wp.func
def key_tail(sensor: Sensor, y: wp.int32, x: wp.int32, c: wp.int32, on: wp.bool):
    """Returns the part of a key that a pixel's events of one polarity share."""
    place = (wp.int64(y) << sensor.shift_y) | (wp.int64(x) << sensor.shift_x)
    return place | wp.int64(c * 2) | wp.where(on, wp.int64(1), wp.int64(0))


@wp.func
def with_mark(key: wp.int64, noise: wp.bool):
    """Returns the key of a sensor that marks its events, where key_tail has left the bit below the place free."""
    low = key & wp.int64(7)
    return (key ^ low) | (low << wp.int64(1)) | wp.where(noise, wp.int64(1), wp.int64(0))


@wp.func
def key_time(sensor: Sensor, t: wp.int64):
    """Returns the part of a key that is its time, t [ns] after the message's start."""
    return t << sensor.shift_t


@wp.func
def time_of(sensor: Sensor, key: wp.int64):
    """Returns the time of a key [ns after the message's start]."""
    one = wp.int64(1)
    return (key >> sensor.shift_t) & ((one << (sensor.shift_env - sensor.shift_t)) - one)


@wp.func
def row_of(sensor: Sensor, key: wp.int64):
    """Returns the row y of a key."""
    one = wp.int64(1)
    return (key >> sensor.shift_y) & ((one << (sensor.shift_t - sensor.shift_y)) - one)


@wp.func
def column_of(sensor: Sensor, key: wp.int64):
    """Returns the column x of a key."""
    one = wp.int64(1)
    return (key >> sensor.shift_x) & ((one << (sensor.shift_y - sensor.shift_x)) - one)


@wp.struct
class Columns:
    """Holds the columns of events: t [ns], x, y, polarity, colour channel (of length 0 without colour), signal (the
    same without marks)."""

    t: wp.array(dtype=wp.int64)
    x: wp.array(dtype=wp.uint16)
    y: wp.array(dtype=wp.uint16)
    p: wp.array(dtype=wp.uint8)
    c: wp.array(dtype=wp.uint8)
    signal: wp.array(dtype=wp.uint8)


@wp.func
def unpack_to(sensor: Sensor, t_base: wp.int64, key: wp.int64, i: wp.int32, columns: Columns):
    """Writes one event to place i of the columns."""
    columns.t[i] = t_base + time_of(sensor, key)
    columns.y[i] = wp.uint16(row_of(sensor, key))
    columns.x[i] = wp.uint16(column_of(sensor, key))
    # Below the place stand channel and polarity and, of a sensor that marks its events, the mark.
    low = key >> (sensor.shift_x - wp.int64(3))
    columns.p[i] = wp.uint8(low & wp.int64(1))
    if i < columns.c.shape[0]:
        columns.c[i] = wp.uint8((low >> wp.int64(1)) & wp.int64(3))
    if i < columns.signal.shape[0]:
        columns.signal[i] = wp.uint8(wp.int64(1) - (key & wp.int64(1)))
