"""Reads memory, or computes, and does nothing else, so that a launch shows the peak rate of the device."""

import warp as wp

wp.set_module_options({"enable_backward": False})

Row = wp.types.vector(length=8, dtype=wp.float32)
CHAINS = 64
"""Operations of one round of `compute`: products and sums of 32 values that do not wait for each other."""


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
    """Multiplies and adds 32 independent values in each thread, over and over."""
    i = wp.tid()
    start = float(i)
    a, b, c, d = Row(start), Row(start + 1.0), Row(start + 2.0), Row(start + 3.0)
    one = Row(0.5)
    for _j in range(rounds):
        a = a * factor + one
        b = b * factor + one
        c = c * factor + one
        d = d * factor + one
    total = a + b + c + d
    if total[0] + total[1] + total[2] + total[3] + total[4] + total[5] + total[6] + total[7] < 0.0:
        sums[0] = total[0]
