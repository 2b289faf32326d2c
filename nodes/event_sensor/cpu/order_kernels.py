# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Sorts keys by time, and unpacks them into columns, on a CPU."""

from pathlib import Path

import warp as wp

from evis.native_code import native_code
from nodes.event_sensor.model.sensor_kernels import Sensor

wp.set_module_options({"enable_backward": False})

MOST_BITS = 11
"""Of a digit: tables of 8 kB stay in the nearest cache."""

ORDER = Path(__file__).with_name("order.h")


@wp.func_native(native_code([ORDER], "counting_pass(source_keys, to, n, shift, bits, add);", {"MOST_BITS": MOST_BITS}))
def counting_pass(source_keys: wp.uint64, to: wp.uint64, n: wp.int64, shift: wp.int64, bits: wp.int32, add: wp.int64):
    """Sorts keys by one stable counting pass over the digit of `bits` bits at `shift`.

    add: what is added to every key on its way. source_keys, to: addresses of n keys.
    """
    ...


@wp.func
def digit_bits(n: wp.int64, bits: wp.int32):
    """Chooses the bits of a digit for the least work with n keys of `bits` bits: passes over the keys and over a table
    each."""
    best = int(MOST_BITS)
    least = wp.int64(wp.static(1 << 62))
    passes = int(1)
    while passes <= bits:
        digit = (bits + passes - 1) // passes
        if digit <= MOST_BITS:
            work = wp.int64(passes) * (wp.int64(3) * n + (wp.int64(1) << wp.int64(digit)))
            if work < least:
                least = work
                best = digit
        passes += 1
    return best


@wp.func
def sort_list(
    # in
    n: wp.int64,
    shift: wp.int64,
    bits: wp.int32,
    add: wp.int64,
    # in and out
    keys: wp.uint64,
    spare: wp.uint64,
    # out
    to: wp.uint64,
):
    """Sorts n keys stably by the `bits` bits at `shift`; what comes out is `add` more. Of addresses; keys and spare
    are overwritten."""
    digit = digit_bits(n, bits)
    source = keys
    target = spare
    done = int(0)
    while done < bits:
        here = wp.min(digit, bits - done)
        if done + here == bits:
            counting_pass(source, to, n, shift + wp.int64(done), here, add)
        else:
            counting_pass(source, target, n, shift + wp.int64(done), here, wp.int64(0))
        following = source
        source = target
        target = following
        done += here


@wp.kernel
def radix_pass(
    # in
    count: wp.int32,
    shift: wp.int64,
    bits: wp.int32,
    source: wp.array(dtype=wp.int64),
    # out
    target: wp.array(dtype=wp.int64),
):
    """Makes a counting_pass over arrays."""
    counting_pass(wp.uint64(source.ptr), wp.uint64(target.ptr), wp.int64(count), shift, bits, wp.int64(0))


@wp.func_native(native_code([ORDER], "to_columns(sensor, t_base, keys, t, x, y, p);", {"MOST_BITS": MOST_BITS}))
def to_columns(
    sensor: Sensor, t_base: wp.int64, keys: wp.array(dtype=wp.int64), t: wp.array(dtype=wp.int64),
    x: wp.array(dtype=wp.uint16), y: wp.array(dtype=wp.uint16), p: wp.array(dtype=wp.uint8),
):  # fmt: skip
    """Writes keys to columns; the colour channel is read apart, where there is one."""
    ...


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
    """Writes keys to columns, by one thread."""
    to_columns(sensor, t_base, keys, t, x, y, p)
