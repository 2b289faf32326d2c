"""libcaer_cmp words to events, one after the other; the twin of `libcaer_cmp.Decoder.decode_words`."""

import warp as wp

from evis.events.codecs.mask_kernels import ones, put_rows
from evis.events.codecs.writing_kernels import Sink, bound_of, report


@wp.kernel(module="unique", enable_backward=False)
def decode_libcaer_cmp(
    # in
    words: wp.array(dtype=wp.uint16),
    start: wp.int64,
    limit_us: wp.int64,
    width: int,
    height: int,
    # out
    to: Sink,
):
    base_us = to.state[1] / wp.int64(1000)
    outside = to.state[3]
    high = int(to.state[4])
    low = int(to.state[5])
    column = int(to.state[6])
    base = int(to.state[7])
    sign = int(to.state[8])
    unknown = to.state[9]
    now = base_us + wp.int64((high << 12) + low)
    # a word gives up to 8 events: stop while they still fit
    last = to.t.shape[0] - 8
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
            before = n
            n = put_rows(before, now * wp.int64(1000), column, row, wp.uint8(polarity), mask, columns, rows, to)
            outside += wp.int64(ones(mask) - n + before)
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
    to.state[3] = outside
    to.state[4] = wp.int64(high)
    to.state[5] = wp.int64(low)
    to.state[6] = wp.int64(column)
    to.state[7] = wp.int64(base)
    to.state[8] = wp.int64(sign)
    to.state[9] = unknown
    report(i, n, 0, next_us, to)
