"""Which pixels of a row something may happen to in a message, on a CPU: in C++, sixteen pixels at a time.

For straight lines between frames; nodes.event_sensor.cpu.run_kernels is the same for curves.
"""

import warp as wp

from nodes.event_sensor.model.inactive_kernels import Quiet
from nodes.event_sensor.model.state_kernels import Cold

wp.set_module_options({"enable_backward": False})

LIST = """
    typedef float floats __attribute__((vector_size(64)));
    typedef int ints __attribute__((vector_size(64)));
    typedef wp::int64 longs __attribute__((vector_size(128)));
    typedef bool flags __attribute__((ext_vector_type(16)));
    const float* v = luminance.data + at;
    const float* lows = quiet.low.data + index;
    const float* highs = quiet.high.data + index;
    float* lasts = quiet.last.data + index;
    const bool timed = quiet.wake.shape[0] > 0;
    const wp::int64* wakes = timed ? quiet.wake.data + index : nullptr;
    const wp::int64 end = (wp::int64)(count - 1) * stride;
    int* list = loud.data + 1;
    int n = 0;
    const auto step = [&](int i, int many) __attribute__((always_inline)) {
        floats low = {}, high = {}, last = {}, sample = {};
        memcpy(&low, lows + i, many * sizeof(float));
        memcpy(&high, highs + i, many * sizeof(float));
        memcpy(&last, lasts + i, many * sizeof(float));
        ints stays = low == low;
        for (wp::int64 k = 0; k <= end; k += stride) {
            memcpy(&sample, v + k + i, many * sizeof(float));
            stays &= (sample >= low) & (sample <= high);
        }
        flags still = __builtin_convertvector(stays, flags);
        if (timed) {
            longs wake = {};
            memcpy(&wake, wakes + i, many * sizeof(wp::int64));
            still &= __builtin_convertvector(wake > t_end, flags);
        }
        last = __builtin_convertvector(still, ints) != 0 ? sample : last;
        memcpy(lasts + i, &last, many * sizeof(float));
        unsigned short lanes;
        memcpy(&lanes, &still, sizeof(lanes));
        for (unsigned left = ~(unsigned)lanes & (0xFFFFu >> (16 - many)); left != 0; left &= left - 1) {
            const int place = i + __builtin_ctz(left);
            // What is kept of the pixel can be on its way.
            __builtin_prefetch(colds.data + index + place, 1, 3);
            list[n++] = place;
        }
    };
    int i = 0;
    for (; i + 16 <= row; i += 16) step(i, 16);
    if (i < row) step(i, row - i);
    loud.data[0] = n;
"""


@wp.func_native(LIST)
def list_loud_row(
    luminance: wp.array(dtype=wp.float32), at: wp.int64, stride: wp.int64, count: wp.int32, t_end: wp.int64,
    quiet: Quiet, index: wp.int32, row: wp.int32, colds: wp.array2d(dtype=Cold), loud: wp.array(dtype=wp.int32),
):  # fmt: skip
    """List the pixels whose samples leave their band, or that wake by `t_end`; the others have their last sample.

    at, index: of the row's first pixel, in the first of `count` frames and in the state; stride: from frame to frame.
    loud: their number, then their places.
    """
    ...
