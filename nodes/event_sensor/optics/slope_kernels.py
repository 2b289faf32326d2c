"""Computes products and quotients of images, for slopes seen through a blur."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def product(
    # in
    a: wp.array(dtype=wp.float32),
    b: wp.array(dtype=wp.float32),
    # out
    result: wp.array(dtype=wp.float32),
):
    """Computes a b, sample by sample."""
    i = wp.tid()
    result[i] = a[i] * b[i]


@wp.kernel
def quotient(
    # in
    a: wp.array(dtype=wp.float32),
    b: wp.array(dtype=wp.float32),
    # out
    result: wp.array(dtype=wp.float32),
):
    """Computes a / b, sample by sample."""
    i = wp.tid()
    result[i] = a[i] / b[i]
