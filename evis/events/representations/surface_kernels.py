"""Computes time surfaces in Warp kernels: the latest event of each pixel, and its age."""

from typing import Any

import warp as wp

from evis.events.representations.column_kernels import environment_of
from evis.events.representations.sum_kernels import SIGNED, SPLIT, has_place

wp.set_module_options({"enable_backward": False})

EXPONENTIAL = wp.constant(0)
NEVER_SEEN = wp.constant(wp.int64(-9223372036854775807))


@wp.kernel
def latest_kernel(
    # in
    t: wp.array(dtype=wp.int64),
    x: wp.array(dtype=Any),
    y: wp.array(dtype=Any),
    p: wp.array(dtype=Any),
    offsets: wp.array(dtype=wp.int64),
    window: wp.array2d(dtype=wp.int64),
    # in and out
    latest: wp.array4d(dtype=wp.int64),
    # out
    outside: wp.array2d(dtype=wp.int64),
):
    """Keeps the time of the latest event of each pixel and polarity.

    Args:
        t, x, y, p, offsets: events and their environments.
        window: times that count, of each environment [E, 2, ns].
        latest: the times so far, OFF and ON [E, 2, H, W, ns].
        outside: gets the events without a place [E, 2].
    """
    i = wp.tid()
    env = environment_of(wp.int64(i), offsets)
    column = wp.int32(x[i])
    row = wp.int32(y[i])
    if not has_place(env, t[i], column, row, latest.shape[2], latest.shape[3], window, outside):
        return
    on = wp.int32(0)
    if wp.int32(p[i]) > 0:
        on = 1
    wp.atomic_max(latest, env, on, row, column, t[i])


@wp.func
def faded(t: wp.int64, at: wp.int64, tau_ns: wp.int64, decay: wp.int32):
    """Computes the value of an event at time t: exp(-age / tau), or max(0, 1 - age / tau); 0 where there was none."""
    if t == NEVER_SEEN:
        return wp.float32(0.0)
    age = at - t
    if age < wp.int64(0):  # more than 2^63 ns
        age = wp.int64(9223372036854775807)
    ages = wp.float32(wp.float64(age) / wp.float64(tau_ns))
    if decay == EXPONENTIAL:
        return wp.exp(-ages)
    return wp.max(wp.float32(0.0), wp.float32(1.0) - ages)


@wp.kernel
def surface_kernel(
    # in
    latest: wp.array4d(dtype=wp.int64),
    at: wp.array(dtype=wp.int64),
    tau_ns: wp.int64,
    decay: wp.int32,
    polarity: wp.int32,
    # out
    values: wp.array4d(dtype=wp.float32),
):
    """Computes the time surface of one pixel per thread (Lagorce et al., TPAMI 2017, eq. 2, for the exponential one).

    Args:
        latest: times of the latest OFF and ON events [E, 2, H, W, ns].
        at: when the surface is looked at [E, ns].
        tau_ns: time constant.
        decay: EXPONENTIAL, or linear.
        polarity: SPLIT, SIGNED (of two at the same time ON wins), or the latest of either.
        values: gets the surface [E, C, H, W].
    """
    env, y, x = wp.tid()
    off = latest[env, 0, y, x]
    on = latest[env, 1, y, x]
    if polarity == SPLIT:
        values[env, 0, y, x] = faded(off, at[env], tau_ns, decay)
        values[env, 1, y, x] = faded(on, at[env], tau_ns, decay)
        return
    value = faded(wp.max(off, on), at[env], tau_ns, decay)
    if polarity == SIGNED and off > on:
        value = -value
    values[env, 0, y, x] = value
