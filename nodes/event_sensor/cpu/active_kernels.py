"""Finds the pixels of a row that may have an event in a message, on a CPU: in C++, sixteen pixels at a time.

For straight lines between frames; nodes.event_sensor.cpu.run_kernels is the same for curves.
"""

from pathlib import Path

import warp as wp

from evis.native_code import native_code
from nodes.event_sensor.model.state_kernels import FrequentState, Rare

wp.set_module_options({"enable_backward": False})

ROWS = Path(__file__).with_name("active.h")
CALL = "list_active_row(luminance, at, stride, count, t_end, state, index, row, rare, first, shared, active);"


@wp.func_native(native_code([ROWS], CALL))
def list_active_row(
    luminance: wp.array(dtype=wp.float32), at: wp.int64, stride: wp.int64, count: wp.int32, t_end: wp.int64,
    state: FrequentState, index: wp.int32, row: wp.int32, rare: wp.array2d(dtype=Rare),
    first: wp.array(dtype=wp.int32), shared: wp.int32, active: wp.array(dtype=wp.int32),
):  # fmt: skip
    """Lists the pixels whose samples leave their inactive range, or that wake by `t_end`; the others keep their last.

    Those with further samples are listed too. first, shared: see batch.SampleLists; first of length 0: there are none.
    at, index: of the row's first pixel, in the first of `count` frames and in the state; stride: from frame to frame.
    active: their number, then their places.
    """
    ...
