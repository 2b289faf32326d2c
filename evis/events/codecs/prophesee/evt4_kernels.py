"""Decodes EVT4 words to events, one after the other; the twin of
`evis.events.codecs.prophesee.evt4.Decoder.decode_words`."""

import warp as wp

from evis.events.codecs.mask_kernels import put_mask
from evis.events.codecs.prophesee.evt2 import HIGH, LOOP, OUTSIDE, TIMED, TYPE_SHIFT, UNKNOWN, UNTIMED
from evis.events.codecs.prophesee.evt2_kernels import (
    channel_of,
    column_of,
    low_of,
    newest_of,
    row_of,
    time_of,
    turns_of,
)
from evis.events.codecs.prophesee.evt4 import COUNTS, OFF, ON, OPEN, PADDING, TIME_HIGH, TRIGGER, VECTOR_OFF, VECTOR_ON
from evis.events.codecs.writing_kernels import Sink, Span, bound_of, keep_inside, put_event, put_trigger, report

FIRST_COUNT, LAST_COUNT = COUNTS


@wp.kernel(module="unique", enable_backward=False)
def decode_evt4(
    # in
    words: wp.array(dtype=wp.uint32),
    span: Span,
    # out
    to: Sink,
):
    """Decodes EVT4 words to events and triggers, one after the other, up to the limit or the end of the room."""
    timed = to.state[TIMED]
    high = to.state[HIGH]
    loop = to.state[LOOP]
    outside = to.state[OUTSIDE]
    untimed = to.state[UNTIMED]
    unknown = to.state[UNKNOWN]
    opened = wp.uint32(to.state[OPEN])
    base = time_of(loop, high)
    # a vector writes up to 32 places: stop while they still fit
    last = to.t.shape[0] - 32
    last_trigger = to.trigger_t.shape[0]
    n = wp.int32(0)
    m = wp.int32(0)
    next_us = wp.int64(-1)
    limit_us = span.limit_us
    i = int(span.start)
    end = words.shape[0]
    columns = bound_of(span.width)
    rows = bound_of(span.height)
    while i < end:
        word = words[i]
        # of a mask, the vector before it says what and when it is
        head = wp.where(opened != wp.uint32(0), opened, word)
        kind = int(head >> wp.uint32(TYPE_SHIFT))
        now = base + low_of(head)
        column = column_of(head)
        row = row_of(head)
        if timed <= wp.int64(0) and kind != TIME_HIGH:
            if opened != wp.uint32(0):
                opened = wp.uint32(0)
            else:
                untimed += wp.int64(1)
                if kind == VECTOR_OFF or kind == VECTOR_ON:
                    opened = word
        elif kind >= OFF and kind <= VECTOR_ON:
            if n > last:
                break
            if now > limit_us:
                next_us = now
                break
            if kind <= ON:
                if row < rows and column < columns:
                    put_event(n, now * wp.int64(1000), column, row, wp.uint8(kind & 1), to)
                    n += 1
                else:
                    outside += wp.int64(1)
            elif opened == wp.uint32(0):
                opened = word
            else:
                opened = wp.uint32(0)
                first = n
                met = put_mask(n, now * wp.int64(1000), column, row, wp.uint8(kind & 1), word, to)
                n = met
                if row >= rows or column + 32 > columns:
                    n = keep_inside(first, met, columns, rows, to)
                    outside += wp.int64(met - n)
        elif kind == TIME_HIGH:
            newest = newest_of(head)
            # after a gap (-1) the time before it still counts, for the turns
            if timed == wp.int64(0):
                high = newest
            timed = wp.int64(1)
            loop = turns_of(loop, high, newest)
            high = newest
            base = time_of(loop, high)
        elif kind == TRIGGER:
            if m >= last_trigger:
                break
            if now > limit_us:
                next_us = now
                break
            put_trigger(m, now * wp.int64(1000), channel_of(head), int(head & wp.uint32(1)), to)
            m += 1
        elif kind != FIRST_COUNT and kind != LAST_COUNT and kind != PADDING:
            unknown += wp.int64(1)
        i += 1
    to.state[TIMED] = timed
    to.state[HIGH] = high
    to.state[LOOP] = loop
    to.state[OUTSIDE] = outside
    to.state[UNTIMED] = untimed
    to.state[UNKNOWN] = unknown
    to.state[OPEN] = wp.int64(opened)
    report(i, n, m, next_us, to)
