"""Sums events in Warp kernels: into voxels that share each between two bins, and into stacks of counts."""

from typing import Any

import warp as wp

from evis.events.representations.column_kernels import environment_of

wp.set_module_options({"enable_backward": False})

SIGNED = wp.constant(0)
SPLIT = wp.constant(1)
BY_TIME = wp.constant(0)
ONE = wp.constant(wp.int64(4294967296))
"""Fixed point of the weights, 2^32: integers add to the same sum in any order; a voxel holds 2^31 events."""
ONE_AS_FLOAT = wp.constant(wp.float64(4294967296.0))


@wp.func
def has_place(
    env: wp.int32,
    t: wp.int64,
    x: wp.int32,
    y: wp.int32,
    height: wp.int32,
    width: wp.int32,
    window: wp.array2d(dtype=wp.int64),
    outside: wp.array2d(dtype=wp.int64),
):
    """Tells whether an event lies in the window and in the array, and counts it where it does not."""
    if t < window[env, 0] or t > window[env, 1]:
        wp.atomic_add(outside, env, 0, wp.int64(1))
        return False
    if x < 0 or y < 0 or x >= width or y >= height:
        wp.atomic_add(outside, env, 1, wp.int64(1))
        return False
    return True


@wp.func
def first_channel(polarity: wp.int32, on: wp.bool, bins: wp.int32):
    """Returns the channel of bin 0; with split polarity the bins of OFF events come first."""
    if polarity == SPLIT and on:
        return bins
    return 0


@wp.func
def sign_of(polarity: wp.int32, on: wp.bool):
    """Returns the weight of an event: -1 for OFF events of signed polarity, otherwise 1."""
    if polarity == SIGNED and not on:
        return -1
    return 1


@wp.kernel
def voxel_kernel(
    # in
    t: wp.array(dtype=wp.int64),
    x: wp.array(dtype=Any),
    y: wp.array(dtype=Any),
    p: wp.array(dtype=Any),
    offsets: wp.array(dtype=wp.int64),
    window: wp.array2d(dtype=wp.int64),
    polarity: wp.int32,
    bins: wp.int32,
    # out
    voxels: wp.array4d(dtype=wp.int64),
    outside: wp.array2d(dtype=wp.int64),
):
    """Adds each event to the two bins nearest in time, by 1 - |b - t*| (Zhu et al., CVPR 2019, eqs. 1 and 2).

    Args:
        t, x, y, p, offsets: events and their environments.
        window: first and last time of each environment [E, 2, ns].
        polarity: SIGNED, SPLIT, or neither.
        bins: number of bins B.
        voxels: gets the weights times ONE [E, C, H, W].
        outside: gets the events without a place [E, 2].
    """
    i = wp.tid()
    env = environment_of(wp.int64(i), offsets)
    column = wp.int32(x[i])
    row = wp.int32(y[i])
    if not has_place(env, t[i], column, row, voxels.shape[2], voxels.shape[3], window, outside):
        return
    length = wp.max(window[env, 1] - window[env, 0], wp.int64(1))
    at = wp.float64(bins - 1) * wp.float64(t[i] - window[env, 0]) / wp.float64(length)
    at = wp.clamp(at, wp.float64(0.0), wp.float64(bins - 1))  # a window of more than 2^63 ns
    b = wp.int32(at)
    later = wp.int64((at - wp.float64(b)) * ONE_AS_FLOAT + wp.float64(0.5))
    on = wp.int32(p[i]) > 0
    c = first_channel(polarity, on, bins) + b
    sign = wp.int64(sign_of(polarity, on))
    wp.atomic_add(voxels, env, c, row, column, sign * (ONE - later))
    if b + 1 < bins:
        wp.atomic_add(voxels, env, c + 1, row, column, sign * later)


@wp.kernel
def stack_kernel(
    # in
    t: wp.array(dtype=wp.int64),
    x: wp.array(dtype=Any),
    y: wp.array(dtype=Any),
    p: wp.array(dtype=Any),
    offsets: wp.array(dtype=wp.int64),
    window: wp.array2d(dtype=wp.int64),
    polarity: wp.int32,
    bins: wp.int32,
    by: wp.int32,
    # out
    stack: wp.array4d(dtype=wp.int32),
    outside: wp.array2d(dtype=wp.int64),
):
    """Counts each event in one of B slices of equal length, or of equal number (Wang et al., CVPR 2019, sec. 3.1).

    Args:
        t, x, y, p, offsets: events and their environments.
        window: first and last time of each environment [E, 2, ns].
        polarity: SIGNED, SPLIT, or neither.
        bins: number of slices B.
        by: BY_TIME, or by number.
        stack: gets the counts [E, C, H, W].
        outside: gets the events without a place [E, 2].
    """
    i = wp.tid()
    env = environment_of(wp.int64(i), offsets)
    column = wp.int32(x[i])
    row = wp.int32(y[i])
    if not has_place(env, t[i], column, row, stack.shape[2], stack.shape[3], window, outside):
        return
    part = wp.int64(i) - offsets[env]
    whole = offsets[env + 1] - offsets[env]
    if by == BY_TIME:
        part = t[i] - window[env, 0]
        whole = window[env, 1] - window[env, 0]
    b = wp.int32(wp.float64(bins) * wp.float64(part) / wp.float64(wp.max(whole, wp.int64(1))))
    b = wp.clamp(b, 0, bins - 1)
    on = wp.int32(p[i]) > 0
    wp.atomic_add(stack, env, first_channel(polarity, on, bins) + b, row, column, sign_of(polarity, on))


@wp.kernel
def weights_kernel(
    # in
    voxels: wp.array(dtype=wp.int64),
    # out
    values: wp.array(dtype=wp.float32),
):
    """Converts fixed-point sums to float32."""
    i = wp.tid()
    values[i] = wp.float32(wp.float64(voxels[i]) / ONE_AS_FLOAT)


@wp.kernel
def row_moments_kernel(
    # in
    values: wp.array3d(dtype=wp.float32),
    # out
    moments: wp.array3d(dtype=wp.float64),
):
    """Computes number, sum and sum of squares of the voxels that are not 0, of one row of pixels per thread.

    Args:
        values: voxels [E, rows, W].
        moments: gets the three of each row [E, rows, 3].
    """
    env, row = wp.tid()
    number = wp.float64(0.0)
    total = wp.float64(0.0)
    squares = wp.float64(0.0)
    for column in range(values.shape[2]):
        value = wp.float64(values[env, row, column])
        if value != wp.float64(0.0):
            number += wp.float64(1.0)
            total += value
            squares += value * value
    moments[env, row, 0] = number
    moments[env, row, 1] = total
    moments[env, row, 2] = squares


@wp.kernel
def spread_kernel(
    # in
    moments: wp.array3d(dtype=wp.float64),
    # out
    spread: wp.array2d(dtype=wp.float64),
):
    """Computes mean and standard deviation of each environment, its rows taken in their order [E, 2]."""
    env = wp.tid()
    number = wp.float64(0.0)
    total = wp.float64(0.0)
    squares = wp.float64(0.0)
    for row in range(moments.shape[1]):
        number += moments[env, row, 0]
        total += moments[env, row, 1]
        squares += moments[env, row, 2]
    number = wp.max(number, wp.float64(1.0))
    mean = total / number
    spread[env, 0] = mean
    spread[env, 1] = wp.sqrt(wp.max(squares / number - mean * mean, wp.float64(0.0)))


@wp.kernel
def normalise_kernel(
    # in
    spread: wp.array2d(dtype=wp.float64),
    # out
    values: wp.array3d(dtype=wp.float32),
):
    """Scales the voxels that are not 0 to mean 0 and standard deviation 1; equal ones all become 0."""
    env, row, column = wp.tid()
    value = wp.float64(values[env, row, column])
    if value != wp.float64(0.0):
        value -= spread[env, 0]
        if spread[env, 1] > wp.float64(0.0):
            value /= spread[env, 1]
        values[env, row, column] = wp.float32(value)
