"""Sequential decoders as Warp CPU kernels (dim = 1): one loop over the words, state in an int64 vector.

Each kernel is a module of its own, so that only the codec in use is compiled. The numpy twin of each is
`Decoder.decode_words` of its codec; state layouts are described there. `out` = next word, events, triggers, time [us]
of the event at the cut or -1.
"""

import numpy as np
import warp as wp

wp.config.log_level = wp.LOG_WARNING


@wp.kernel(module="unique", enable_backward=False)
def decode_evt3(
    # in
    words: wp.array(dtype=wp.uint16),
    start: wp.int64,
    limit_us: wp.int64,
    width: int,
    height: int,
    # out
    state: wp.array(dtype=wp.int64),
    out: wp.array(dtype=wp.int64),
    t: wp.array(dtype=wp.int64),
    x: wp.array(dtype=wp.uint16),
    y: wp.array(dtype=wp.uint16),
    p: wp.array(dtype=wp.uint8),
    trigger_t: wp.array(dtype=wp.int64),
    trigger_id: wp.array(dtype=wp.uint8),
    trigger_value: wp.array(dtype=wp.uint8),
):
    timed = state[0]
    high = int(state[1])
    low = int(state[2])
    loop = state[3]
    row = int(state[4])
    base = int(state[5])
    sign = wp.uint8(state[6])
    outside = state[7]
    untimed = state[8]
    now = (loop << wp.int64(24)) + wp.int64((high << 12) + low)
    now_ns = now * wp.int64(1000)
    # a vector gives up to 12 events: stop while they still fit
    last = t.shape[0] - 12
    last_trigger = trigger_t.shape[0]
    n = wp.int32(0)
    m = wp.int32(0)
    next_us = wp.int64(-1)
    i = int(start)
    end = words.shape[0]
    columns = width
    if width == 0:
        columns = 65536
    rows = height
    if height == 0:
        rows = 65536
    while timed == wp.int64(0) and i < end:
        if (int(words[i]) >> 12) == 8:
            timed = wp.int64(1)
            high = int(words[i]) & 0xFFF
        else:
            untimed += wp.int64(1)
            i += 1
    while i < end:
        word = int(words[i])
        kind = word >> 12
        value = word & 0xFFF
        if kind == 2 or kind == 4 or kind == 5:
            if n > last:
                break
            if now > limit_us:
                next_us = now
                break
            if kind == 2:
                column = value & 0x7FF
                if row >= rows or column >= columns:
                    outside += wp.int64(1)
                else:
                    t[n] = now_ns
                    x[n] = wp.uint16(column)
                    y[n] = wp.uint16(row)
                    p[n] = wp.uint8(value >> 11)
                    n += 1
            else:
                pixels = 12
                if kind == 5:
                    pixels = 8
                    value = value & 0xFF
                column = base
                while value != 0:
                    if (value & 1) != 0:
                        pixel = column & 0xFFFF
                        if row >= rows or pixel >= columns:
                            outside += wp.int64(1)
                        else:
                            t[n] = now_ns
                            x[n] = wp.uint16(pixel)
                            y[n] = wp.uint16(row)
                            p[n] = sign
                            n += 1
                    value = value >> 1
                    column += 1
                base = (base + pixels) & 0xFFFF
        elif kind == 0:
            row = value & 0x7FF
        elif kind == 3:
            base = value & 0x7FF
            sign = wp.uint8(value >> 11)
        elif kind == 6:
            low = value
            now = (loop << wp.int64(24)) + wp.int64((high << 12) + low)
            now_ns = now * wp.int64(1000)
        elif kind == 8:
            if high >= value + 2048:
                loop += wp.int64(1)
            if high != value:
                low = 0
            high = value
            now = (loop << wp.int64(24)) + wp.int64((high << 12) + low)
            now_ns = now * wp.int64(1000)
        elif kind == 10:
            if m >= last_trigger:
                break
            if now > limit_us:
                next_us = now
                break
            trigger_t[m] = now_ns
            trigger_id[m] = wp.uint8((value >> 8) & 15)
            trigger_value[m] = wp.uint8(value & 1)
            m += 1
        i += 1
    state[0] = timed
    state[1] = wp.int64(high)
    state[2] = wp.int64(low)
    state[3] = loop
    state[4] = wp.int64(row)
    state[5] = wp.int64(base)
    state[6] = wp.int64(sign)
    state[7] = outside
    state[8] = untimed
    out[0] = wp.int64(i)
    out[1] = wp.int64(n)
    out[2] = wp.int64(m)
    out[3] = next_us


@wp.kernel(module="unique", enable_backward=False)
def decode_evt2(
    # in
    words: wp.array(dtype=wp.uint32),
    start: wp.int64,
    limit_us: wp.int64,
    width: int,
    height: int,
    # out
    state: wp.array(dtype=wp.int64),
    out: wp.array(dtype=wp.int64),
    t: wp.array(dtype=wp.int64),
    x: wp.array(dtype=wp.uint16),
    y: wp.array(dtype=wp.uint16),
    p: wp.array(dtype=wp.uint8),
    trigger_t: wp.array(dtype=wp.int64),
    trigger_id: wp.array(dtype=wp.uint8),
    trigger_value: wp.array(dtype=wp.uint8),
):
    timed = state[0]
    high = state[1]
    loop = state[2]
    outside = state[3]
    untimed = state[4]
    base = (loop << wp.int64(34)) + (high << wp.int64(6))
    capacity = t.shape[0]
    last_trigger = trigger_t.shape[0]
    n = wp.int32(0)
    m = wp.int32(0)
    next_us = wp.int64(-1)
    i = int(start)
    end = words.shape[0]
    while i < end:
        word = words[i]
        kind = int(word >> wp.uint32(28))
        if timed == wp.int64(0) and kind != 8:
            untimed += wp.int64(1)
        elif kind < 2:
            if n >= capacity:
                break
            now = base + wp.int64((word >> wp.uint32(22)) & wp.uint32(63))
            if now > limit_us:
                next_us = now
                break
            column = int((word >> wp.uint32(11)) & wp.uint32(0x7FF))
            row = int(word & wp.uint32(0x7FF))
            if (height > 0 and row >= height) or (width > 0 and column >= width):
                outside += wp.int64(1)
            else:
                t[n] = now * wp.int64(1000)
                x[n] = wp.uint16(column)
                y[n] = wp.uint16(row)
                p[n] = wp.uint8(kind)
                n += 1
        elif kind == 8:
            value = wp.int64(word & wp.uint32(0xFFFFFFF))
            if timed == wp.int64(0):
                timed = wp.int64(1)
                high = value
            if high >= value + (wp.int64(1) << wp.int64(27)):
                loop += wp.int64(1)
            high = value
            base = (loop << wp.int64(34)) + (high << wp.int64(6))
        elif kind == 10:
            if m >= last_trigger:
                break
            now = base + wp.int64((word >> wp.uint32(22)) & wp.uint32(63))
            if now > limit_us:
                next_us = now
                break
            trigger_t[m] = now * wp.int64(1000)
            trigger_id[m] = wp.uint8((word >> wp.uint32(8)) & wp.uint32(31))
            trigger_value[m] = wp.uint8(word & wp.uint32(1))
            m += 1
        i += 1
    state[0] = timed
    state[1] = high
    state[2] = loop
    state[3] = outside
    state[4] = untimed
    out[0] = wp.int64(i)
    out[1] = wp.int64(n)
    out[2] = wp.int64(m)
    out[3] = next_us


DECODE = {"evt3": decode_evt3, "evt2": decode_evt2}


def view(array: np.ndarray) -> wp.array:
    """The same memory as a Warp array on the CPU."""
    return wp.array(array, dtype=wp.dtype_from_numpy(array.dtype), device="cpu", copy=False)


def launch(kernel: wp.Kernel, inputs: list, outputs: list) -> None:
    """One thread over the whole buffer. The first output is the decoder's state, a numpy vector."""
    wp.launch(kernel, dim=1, inputs=inputs, outputs=[view(outputs[0]), *outputs[1:]], device="cpu")
