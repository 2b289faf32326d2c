"""libcaer_cmp words to events, one after the other; the twin of `evis.streams.ecm_libcaer_cmp.Decoder.decode_words`."""

import warp as wp

from evis.streams.kernels_writing import bound_of, put_event, report


@wp.kernel(module="unique", enable_backward=False)
def decode_libcaer_cmp(
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
    base_us = state[1] / wp.int64(1000)
    outside = state[3]
    high = int(state[4])
    low = int(state[5])
    column = int(state[6])
    base = int(state[7])
    sign = int(state[8])
    unknown = state[9]
    now = base_us + wp.int64((high << 12) + low)
    # a word gives up to 8 events: stop while they still fit
    last = t.shape[0] - 8
    n = wp.int32(0)
    next_us = wp.int64(-1)
    i = int(start)
    end = words.shape[0]
    columns = bound_of(width)
    rows = bound_of(height)
    while i < end:
        word = int(words[i])
        kind = word >> 12
        value = word & 0xFFF
        if kind == 3 or kind == 5:
            if n > last:
                break
            if now > limit_us:
                next_us = now
                break
            row = base
            polarity = sign
            mask = value & 0xFF
            if kind == 3:
                row = value & 0x7FF
                polarity = value >> 11
                mask = 1
            else:
                base = (base + 8) & 0xFFFF
            while mask != 0:
                if (mask & 1) != 0:
                    pixel = row & 0xFFFF
                    if pixel >= rows or column >= columns:
                        outside += wp.int64(1)
                    else:
                        put_event(n, now * wp.int64(1000), column, pixel, wp.uint8(polarity), t, x, y, p)
                        n += 1
                mask = mask >> 1
                row += 1
        elif kind == 0:
            high = value
            now = base_us + wp.int64((high << 12) + low)
        elif kind == 1:
            low = value
            now = base_us + wp.int64((high << 12) + low)
        elif kind == 2:
            column = value & 0x7FF
        elif kind == 4:
            base = value & 0x7FF
            sign = value >> 11
        else:
            unknown += wp.int64(1)
        i += 1
    state[3] = outside
    state[4] = wp.int64(high)
    state[5] = wp.int64(low)
    state[6] = wp.int64(column)
    state[7] = wp.int64(base)
    state[8] = wp.int64(sign)
    state[9] = unknown
    report(i, n, 0, next_us, out)
