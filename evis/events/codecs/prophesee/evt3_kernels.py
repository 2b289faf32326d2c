"""Decodes EVT3 words to events, one after the other; the twin of
`evis.events.codecs.prophesee.evt3.Decoder.decode_words`."""

import warp as wp

from evis.events.codecs.mask_kernels import put_vector
from evis.events.codecs.prophesee import evt3
from evis.events.codecs.prophesee.evt3 import (
    ADDR_X,
    ADDR_Y,
    ADDRESS,
    BASE,
    CONTINUED,
    HALF_TURN,
    HIGH,
    LOOP,
    LOW,
    OUTSIDE,
    ROW,
    SIGN,
    TIME_HIGH,
    TIME_LOW,
    TIMED,
    TRIGGER,
    UNKNOWN,
    UNTIMED,
    VECT_8,
    VECT_12,
    VECT_BASE_X,
)
from evis.events.codecs.prophesee.run_kernels import evt3_run
from evis.events.codecs.writing_kernels import Sink, Span, bound_of, keep_inside, put_event, put_trigger, report

FIRST_PADDING = min(evt3.PADDING)
PIXELS_12, PIXELS_8 = evt3.VECTOR_PIXELS[VECT_12], evt3.VECTOR_PIXELS[VECT_8]


@wp.func
def start_of(loop: wp.int64, high: wp.int32):
    """Computes the time [us] at which a TIME_HIGH begins, after `loop` turns."""
    return (loop << wp.int64(24)) + wp.int64(high << 12)


@wp.func
def latest_of(limit_us: wp.int64, since: wp.int64):
    """Computes the last TIME_LOW that is not later than the limit; -1 for none."""
    return int(wp.clamp(limit_us - since, wp.int64(-1), wp.int64(4096)))


@wp.kernel(module="unique", enable_backward=False)
def decode_evt3(
    # in
    words: wp.array(dtype=wp.uint16),
    span: Span,
    # out
    to: Sink,
):
    """Decodes EVT3 words to events and triggers, one after the other, up to the limit or the end of the room."""
    timed = to.state[TIMED]
    high = int(to.state[HIGH])
    low = int(to.state[LOW])
    loop = to.state[LOOP]
    row = int(to.state[ROW])
    base = int(to.state[BASE])
    sign = wp.uint8(to.state[SIGN])
    outside = to.state[OUTSIDE]
    untimed = to.state[UNTIMED]
    unknown = to.state[UNKNOWN]
    # a vector writes 12 places: stop while they still fit
    last = to.t.shape[0] - PIXELS_12
    last_trigger = to.trigger_t.shape[0]
    n = wp.int32(0)
    m = wp.int32(0)
    next_us = wp.int64(-1)
    limit_us = span.limit_us
    i = int(span.start)
    end = words.shape[0]
    columns = bound_of(span.width)
    rows = bound_of(span.height)
    while timed <= wp.int64(0) and i < end:
        if int(words[i]) >> 12 == TIME_HIGH:
            # after a gap (-1) the time before it still counts, for the turns
            if timed == wp.int64(0):
                high = int(words[i]) & 0xFFF
            timed = wp.int64(1)
        else:
            untimed += wp.int64(1)
            i += 1
    # times are `since` + the low part
    since = start_of(loop, high)
    latest = latest_of(limit_us, since)
    while i < end:
        if n > last:
            break
        word = int(words[i])
        kind = word >> 12
        value = word & 0xFFF
        if kind == ADDR_X:
            if low > latest:
                next_us = since + wp.int64(low)
                break
            to.state[LOW] = wp.int64(low)
            to.state[ROW] = wp.int64(row)
            # each word gives one event at most
            stop = wp.min(end, i + last - n + 1)
            i = evt3_run(words, i, stop, since, high, latest, n, to)
            met = int(to.out[1])
            kept = keep_inside(n, met, columns, rows, to)
            outside += wp.int64(met - kept)
            n = kept
            low = int(to.state[LOW])
            row = int(to.state[ROW])
            continue
        if kind == ADDR_Y:
            row = value & ADDRESS
        elif kind == VECT_BASE_X:
            base = value & ADDRESS
            sign = wp.uint8(value >> 11)
        elif kind == VECT_12 or kind == VECT_8:
            if low > latest:
                next_us = since + wp.int64(low)
                break
            now_ns = (since + wp.int64(low)) * wp.int64(1000)
            pixels = wp.where(kind == VECT_12, PIXELS_12, PIXELS_8)
            value = value & ((1 << pixels) - 1)
            if row < rows and base + PIXELS_12 <= columns:
                n = put_vector(n, now_ns, base, row, sign, value, to)
            else:
                column = base
                while value != 0:
                    pixel = column & 0xFFFF
                    if (value & 1) != 0:
                        if row < rows and pixel < columns:
                            put_event(n, now_ns, pixel, row, sign, to)
                            n += 1
                        else:
                            outside += wp.int64(1)
                    value = value >> 1
                    column += 1
            base = (base + pixels) & 0xFFFF
        elif kind == TIME_LOW:
            low = value
        elif kind == TIME_HIGH:
            if high >= value + HALF_TURN:
                loop += wp.int64(1)
            if high != value:
                low = 0
                high = value
                since = start_of(loop, high)
                latest = latest_of(limit_us, since)
        elif kind == TRIGGER:
            if m >= last_trigger:
                break
            if low > latest:
                next_us = since + wp.int64(low)
                break
            now_ns = (since + wp.int64(low)) * wp.int64(1000)
            put_trigger(m, now_ns, (value >> 8) & 15, value & 1, to)
            m += 1
        elif kind != CONTINUED and kind < FIRST_PADDING:
            unknown += wp.int64(1)
        i += 1
    to.state[TIMED] = timed
    to.state[HIGH] = wp.int64(high)
    to.state[LOW] = wp.int64(low)
    to.state[LOOP] = loop
    to.state[ROW] = wp.int64(row)
    to.state[BASE] = wp.int64(base)
    to.state[SIGN] = wp.int64(sign)
    to.state[OUTSIDE] = outside
    to.state[UNTIMED] = untimed
    to.state[UNKNOWN] = unknown
    report(i, n, m, next_us, to)
