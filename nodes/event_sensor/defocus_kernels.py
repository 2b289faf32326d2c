# ruff: noqa: RUF046, UP018 - int(0) is how a Warp kernel declares a variable that changes
"""Kernels of the defocus: one pass of a separable filter, along the rows or down the columns.

weights: of the distances 0, 1, ... radius; the samples at the ends of a line are repeated. On a CPU a thread is a row
of the image, which it filters RUN samples at a time: `runs` arrays are views in which element i is the RUN samples from
i on, so that the compiler makes vector instructions of them at any place.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

RUN = 16
Run = wp.types.vector(length=RUN, dtype=wp.float32)


@wp.func
def filtered(
    weights: wp.array(dtype=wp.float32),
    image: wp.array(dtype=wp.float32),
    i: wp.int32,
    place: wp.int32,
    length: wp.int32,
    stride: wp.int32,
):
    """One sample of the filter along an axis: sample i, at `place` in a line of `length` samples `stride` apart."""
    total = weights[0] * image[i]
    j = int(1)
    while j < weights.shape[0]:
        before = wp.min(j, place)
        after = wp.min(j, length - 1 - place)
        total += weights[j] * (image[i - before * stride] + image[i + after * stride])
        j += 1
    return total


@wp.kernel
def along_rows(
    # in
    weights: wp.array(dtype=wp.float32),
    image: wp.array(dtype=wp.float32),
    runs: wp.array(dtype=Run),
    width: wp.int32,
    channels: wp.int32,
    # out
    blurred: wp.array(dtype=wp.float32),
    blurred_runs: wp.array(dtype=Run),
):
    """Filter along x; a thread is a row."""
    row = width * channels
    start = wp.tid() * row
    margin = wp.min((weights.shape[0] - 1) * channels, row)
    end = row - margin  # of what needs no clamp
    if end - margin < wp.static(RUN):
        margin = row
        end = row
    i = int(0)
    while i < row:
        if i == margin:
            i = end
        blurred[start + i] = filtered(weights, image, start + i, i // channels, width, channels)
        i += 1
    i = margin
    while i < end:
        # The last run reaches back over the one before.
        i = wp.min(i, end - wp.static(RUN))
        total = weights[0] * runs[start + i]
        j = int(1)
        while j < weights.shape[0]:
            total += weights[j] * (runs[start + i - j * channels] + runs[start + i + j * channels])
            j += 1
        blurred_runs[start + i] = total
        i += wp.static(RUN)


@wp.kernel
def down_columns(
    # in
    weights: wp.array(dtype=wp.float32),
    image: wp.array(dtype=wp.float32),
    runs: wp.array(dtype=Run),
    height: wp.int32,
    row: wp.int32,
    # out
    blurred: wp.array(dtype=wp.float32),
    blurred_runs: wp.array(dtype=Run),
):
    """Filter along y; a thread is a row of `row` samples."""
    n, y = wp.tid()
    start = (n * height + y) * row
    i = int(0)
    if row < wp.static(RUN):
        while i < row:
            blurred[start + i] = filtered(weights, image, start + i, y, height, row)
            i += 1
    while i < row:
        i = wp.min(i, row - wp.static(RUN))
        total = weights[0] * runs[start + i]
        j = int(1)
        while j < weights.shape[0]:
            before = wp.min(j, y)
            after = wp.min(j, height - 1 - y)
            total += weights[j] * (runs[start + i - before * row] + runs[start + i + after * row])
            j += 1
        blurred_runs[start + i] = total
        i += wp.static(RUN)


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
    """Filter along an axis of `length` samples `stride` apart; a thread is a sample, for a GPU."""
    outer, place, inner = wp.tid()
    i = (outer * length + place) * stride + inner
    blurred[i] = filtered(weights, image, i, place, length, stride)
