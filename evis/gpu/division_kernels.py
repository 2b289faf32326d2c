"""Divides by numbers that a launch knows beforehand: by a product and a shift, where `//` takes 35 instructions."""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.struct
class Divisor:
    """Holds a divisor as `divided` needs it: factor / 2^shift is a bit more than 1 / divisor."""

    factor: wp.uint64
    shift: int


def divisor(by: int) -> Any:
    """Makes the Divisor of 1 <= by < 2^31 (Granlund and Montgomery, PLDI 1994, Figure 4.1).

    With shift = 32 + ceil(log2 by) the product a factor / 2^shift is above a / by by less than a 2^-32 / by, which no
    quotient of 0 <= a < 2^31 comes near to; and as the factor is at most 2^33, no product overflows.
    """
    if not 1 <= by < 1 << 31:
        raise ValueError(f"a divisor is {by}; it must be 1 ... 2^31 - 1")
    made: Any = Divisor()
    made.shift = 32 + (by - 1).bit_length()
    made.factor = -(-(1 << made.shift) // by)
    return made


@wp.func_native("return (int)(((unsigned long long)(unsigned)a * by.factor) >> by.shift);")
def divided(a: wp.int32, by: Divisor) -> wp.int32:
    """Computes a // by for a >= 0."""
    ...
