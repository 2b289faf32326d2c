"""Finds bits of masks, by the instructions that processors have for them."""

import warp as wp

wp.set_module_options({"enable_backward": False})

LOWEST = """
#if defined(__CUDA_ARCH__)
    return __ffsll((long long)bits) - 1;
#else
    return __builtin_ctzll(bits);
#endif
"""


@wp.func_native(LOWEST)
def lowest(bits: wp.uint64) -> wp.int32:
    """Gives the number of the lowest bit that is set; at least one is."""
    ...
