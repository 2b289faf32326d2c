"""Kernels that do nothing but read, or nothing but compute."""

import warp as wp

wp.set_module_options({"enable_backward": False})

CHAINS = 16
"""Operations of one round of `compute`: products and sums of eight values that do not wait for each other."""


@wp.kernel
def read_again(
    # In
    values: wp.array(dtype=wp.vec4),
    rounds: int,
    # Out
    sums: wp.array(dtype=float),
):
    """Reads values of an array, its length a power of two, over and over: neighbours together, each round elsewhere."""
    i = wp.tid()
    last = values.shape[0] - 1
    total = wp.vec4(0.0, 0.0, 0.0, 0.0)
    for j in range(rounds):
        total += values[(i + j * 36896) & last]
    if total[0] + total[1] + total[2] + total[3] < 0.0:  # never: so that nothing can be left out
        sums[0] = total[0]


@wp.kernel
def compute(
    # In
    factor: float,
    rounds: int,
    # Out
    sums: wp.array(dtype=float),
):
    """Multiplies and adds eight values, each for itself."""
    i = wp.tid()
    a = wp.vec4(float(i), float(i + 1), float(i + 2), float(i + 3))
    b = wp.vec4(float(i + 4), float(i + 5), float(i + 6), float(i + 7))
    one = wp.vec4(0.5, 0.25, 0.125, 0.0625)
    for _j in range(rounds):
        a = a * factor + one
        b = b * factor + one
    total = a + b
    if total[0] + total[1] + total[2] + total[3] < 0.0:
        sums[0] = total[0]
