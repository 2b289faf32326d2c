"""EVT3 words to events, one after the other; the twin of `evis.streams.evt3.Decoder.decode_words`."""

import warp as wp

from evis.streams.kernels_writing import bound_of, put_event, put_trigger, report


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
    unknown = state[9]
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
    columns = bound_of(width)
    rows = bound_of(height)
    while timed <= wp.int64(0) and i < end:
        if (int(words[i]) >> 12) == 8:
            # after a gap (-1) the time before it still counts, for the turns
            if timed == wp.int64(0):
                high = int(words[i]) & 0xFFF
            timed = wp.int64(1)
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
                    put_event(n, now_ns, column, row, wp.uint8(value >> 11), t, x, y, p)
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
                            put_event(n, now_ns, pixel, row, sign, t, x, y, p)
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
            put_trigger(m, now_ns, (value >> 8) & 15, value & 1, trigger_t, trigger_id, trigger_value)
            m += 1
        elif kind != 7 and kind < 14:
            unknown += wp.int64(1)
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
    state[9] = unknown
    report(i, n, m, next_us, out)
