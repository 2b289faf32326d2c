"""Decodes libcaer_cmp words to events, one after the other; the twin of `libcaer_cmp.Decoder.decode_words`."""

import warp as wp

from evis.events.codecs.event_camera_msgs.libcaer_cmp import (
    ADDR_X,
    ADDR_Y,
    ADDRESS_MASK,
    BASE_Y,
    CODE_SHIFT,
    COLUMN,
    DATA_MASK,
    HIGH,
    HIGH_SHIFT,
    LOW,
    ROW,
    ROWS,
    SIGN,
    SIGN_SHIFT,
    TIME_HIGH,
    TIME_LOW,
    UNKNOWN,
    VECT_8,
)
from evis.events.codecs.event_camera_msgs.payload import BASE, OUTSIDE
from evis.events.codecs.mask_kernels import ones, put_rows
from evis.events.codecs.writing_kernels import Sink, Span, bound_of, report


@wp.kernel(module="unique", enable_backward=False)
def decode_libcaer_cmp(
    # in
    words: wp.array(dtype=wp.uint16),
    span: Span,
    # out
    to: Sink,
):
    """Decodes libcaer_cmp words to events, one after the other, up to the limit or the end of the room."""
    base_us = to.state[BASE] / wp.int64(1000)
    outside = to.state[OUTSIDE]
    high = int(to.state[HIGH])
    low = int(to.state[LOW])
    column = int(to.state[COLUMN])
    base = int(to.state[ROW])
    sign = int(to.state[SIGN])
    unknown = to.state[UNKNOWN]
    now = base_us + wp.int64((high << HIGH_SHIFT) + low)
    # a word gives up to 8 events: stop while they still fit
    last = to.t.shape[0] - ROWS
    n = wp.int32(0)
    next_us = wp.int64(-1)
    limit_us = span.limit_us
    i = int(span.start)
    end = words.shape[0]
    columns = bound_of(span.width)
    rows = bound_of(span.height)
    while i < end:
        word = int(words[i])
        kind = word >> CODE_SHIFT
        value = word & DATA_MASK
        if kind == ADDR_Y or kind == VECT_8:
            if n > last:
                break
            if now > limit_us:
                next_us = now
                break
            row = base
            polarity = sign
            mask = value & 0xFF
            if kind == ADDR_Y:
                row = value & ADDRESS_MASK
                polarity = value >> SIGN_SHIFT
                mask = 1
            else:
                base = (base + ROWS) & 0xFFFF
            before = n
            n = put_rows(before, now * wp.int64(1000), column, row, wp.uint8(polarity), mask, columns, rows, to)
            outside += wp.int64(ones(mask) - n + before)
        elif kind == TIME_HIGH:
            high = value
            now = base_us + wp.int64((high << HIGH_SHIFT) + low)
        elif kind == TIME_LOW:
            low = value
            now = base_us + wp.int64((high << HIGH_SHIFT) + low)
        elif kind == ADDR_X:
            column = value & ADDRESS_MASK
        elif kind == BASE_Y:
            base = value & ADDRESS_MASK
            sign = value >> SIGN_SHIFT
        else:
            unknown += wp.int64(1)
        i += 1
    to.state[OUTSIDE] = outside
    to.state[HIGH] = wp.int64(high)
    to.state[LOW] = wp.int64(low)
    to.state[COLUMN] = wp.int64(column)
    to.state[ROW] = wp.int64(base)
    to.state[SIGN] = wp.int64(sign)
    to.state[UNKNOWN] = unknown
    report(i, n, 0, next_us, to)
