# ruff: noqa: RUF046 - int(0) is how a Warp kernel declares a variable that changes
"""Filters along one axis, by rows or columns: a pass of the separable filter of the defocus.

weights: of the distances 0, 1, ... radius; the samples at the ends of a line are repeated. On a CPU a thread is a row
of the image, which it filters RUN samples at a time, in C++: over the strides of a Warp array no loop is vectorised.

Products and sums are rounded apart, in one order: all devices blur to the same bits.
"""

from pathlib import Path

import warp as wp

from evis.native_code import native_code

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

RUN = 16
DEFOCUS = Path(__file__).with_name("defocus.h")


@wp.func
def filtered(
    weights: wp.array(dtype=wp.float32),
    image: wp.array(dtype=wp.float32),
    i: wp.int32,
    place: wp.int32,
    length: wp.int32,
    stride: wp.int32,
):
    """Filters one sample along an axis: sample i, at `place` in a line of `length` samples `stride` apart."""
    total = weights[0] * image[i]
    j = int(1)
    while j < weights.shape[0]:
        before = wp.min(j, place)
        after = wp.min(j, length - 1 - place)
        total += weights[j] * (image[i - before * stride] + image[i + after * stride])
        j += 1
    return total


@wp.func_native(native_code([DEFOCUS], "filter_runs(weights, image, start, channels, margin, end, to, rows);"))
def filter_runs(
    weights: wp.array(dtype=wp.float32),
    image: wp.array(dtype=wp.float32),
    start: wp.int32,
    channels: wp.int32,
    margin: wp.int32,
    end: wp.int32,
    to: wp.int32,
    rows: wp.array(dtype=wp.float32),
):
    """Filters samples margin to end of the row at `start`, without a clamp; the last run reaches back."""
    ...


@wp.func_native(native_code([DEFOCUS], "blend_rows(weights, rows, y, height, ring, row, out, blurred);"))
def blend_rows(
    weights: wp.array(dtype=wp.float32),
    rows: wp.array(dtype=wp.float32),
    y: wp.int32,
    height: wp.int32,
    ring: wp.int32,
    row: wp.int32,
    out: wp.int32,
    blurred: wp.array(dtype=wp.float32),
):
    """Filters row y of the result down the columns of the rows in the ring, to `out`."""
    ...


@wp.func
def row_filtered(
    # in
    weights: wp.array(dtype=wp.float32),
    image: wp.array(dtype=wp.float32),
    start: wp.int32,
    width: wp.int32,
    channels: wp.int32,
    to: wp.int32,
    # out
    rows: wp.array(dtype=wp.float32),
):
    """Filters the row that starts at `start` along x, to `rows` from `to` on."""
    row = width * channels
    taps = weights.shape[0]
    margin = wp.min((taps - 1) * channels, row)
    end = row - margin  # of what needs no clamp
    if end - margin < wp.static(RUN):
        margin = row
        end = row
    i = int(0)
    while i < row:
        if i == margin:
            i = end
        if i < row:
            rows[to + i] = filtered(weights, image, start + i, i // channels, width, channels)
        i += 1
    filter_runs(weights, image, start, channels, margin, end, to, rows)


@wp.kernel(module="unique", enable_backward=False)
def blur_rows(
    # in
    weights: wp.array(dtype=wp.float32),
    image: wp.array(dtype=wp.float32),
    height: wp.int32,
    width: wp.int32,
    channels: wp.int32,
    # in and out
    rows: wp.array(dtype=wp.float32),
    # out
    blurred: wp.array(dtype=wp.float32),
):
    """Blurs a row per thread, in order; `rows` keeps the 2 radius + 1 rows filtered along x that it needs."""
    n, y = wp.tid()
    row = width * channels
    radius = weights.shape[0] - 1
    ring = 2 * radius + 1
    image_at = n * height * row
    ready = y + radius  # rows up to here have been filtered along x
    first = wp.where(y == 0, 0, ready)
    while first <= wp.min(ready, height - 1):
        row_filtered(weights, image, image_at + first * row, width, channels, first % ring * row, rows)
        first += 1
    here = y % ring * row
    out = image_at + y * row
    i = int(0)
    if row < wp.static(RUN):
        while i < row:
            sample = weights[0] * rows[here + i]
            j = int(1)
            while j <= radius:
                above = wp.max(y - j, 0) % ring * row
                below = wp.min(y + j, height - 1) % ring * row
                sample += weights[j] * (rows[above + i] + rows[below + i])
                j += 1
            blurred[out + i] = sample
            i += 1
    else:
        blend_rows(weights, rows, y, height, ring, row, out, blurred)


@wp.kernel
def each_sample(
    # in
    weights: wp.array(dtype=wp.float32),
    image: wp.array(dtype=wp.float32),
    length: wp.int32,
    stride: wp.int32,
    # out
    blurred: wp.array(dtype=wp.float32),
):
    """Filters along an axis of `length` samples `stride` apart; a thread is a sample, for a GPU."""
    outer, place, inner = wp.tid()
    i = (outer * length + place) * stride + inner
    blurred[i] = filtered(weights, image, i, place, length, stride)
