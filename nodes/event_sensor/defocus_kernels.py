# ruff: noqa: RUF046, UP018 - int(0) is how a Warp kernel declares a variable that changes
"""Kernel of the defocus: one pass of a separable filter."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def blur(
    # in
    weights: wp.array(dtype=wp.float32),
    image: wp.array(dtype=wp.float32),
    length: wp.int32,
    stride: wp.int32,
    run: wp.int32,
    # out
    blurred: wp.array(dtype=wp.float32),
):
    """Filter along the axis of `length` samples, `stride` apart; the samples at the ends are repeated.

    weights: of the distances 0, 1, ... radius. A thread does `run` consecutive samples, which differ in the faster
    axes only or, where stride < run, are a whole line.
    """
    first = wp.tid() * run
    radius = weights.shape[0] - 1
    i = first
    while i < first + run:
        place = (i // stride) % length
        total = weights[0] * image[i]
        j = int(1)
        if place >= radius and place + radius < length:
            while j <= radius:
                total += weights[j] * (image[i - j * stride] + image[i + j * stride])
                j += 1
        else:
            while j <= radius:
                before = wp.min(j, place)
                after = wp.min(j, length - 1 - place)
                total += weights[j] * (image[i - before * stride] + image[i + after * stride])
                j += 1
        blurred[i] = total
        i += 1
