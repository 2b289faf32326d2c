"""EVT4 words to events, one after the other; the twin of `evis.events.codecs.prophesee.evt4.Decoder.decode_words`."""

import warp as wp

from evis.events.codecs.prophesee.evt2_kernels import column_of, low_of, row_of, time_of, turns_of
from evis.events.codecs.prophesee.run_kernels import keep_inside, put_mask
from evis.events.codecs.writing_kernels import Sink, bound_of, put_event, put_trigger, report


@wp.kernel(module="unique", enable_backward=False)
def decode_evt4(
    # in
    words: wp.array(dtype=wp.uint32),
    start: wp.int64,
    limit_us: wp.int64,
    width: int,
    height: int,
    # out
    to: Sink,
):
    timed = to.state[0]
    high = to.state[1]
    loop = to.state[2]
    outside = to.state[3]
    untimed = to.state[4]
    unknown = to.state[5]
    opened = wp.uint32(to.state[6])
    base = time_of(loop, high)
    # a vector writes up to 32 places: stop while they still fit
    last = to.t.shape[0] - 32
    last_trigger = to.trigger_t.shape[0]
    n = wp.int32(0)
    m = wp.int32(0)
    next_us = wp.int64(-1)
    i = int(start)
    end = words.shape[0]
    columns = bound_of(width)
    rows = bound_of(height)
    while i < end:
        word = words[i]
        # of a mask, the vector before it says what and when it is
        head = wp.where(opened != wp.uint32(0), opened, word)
        kind = int(head >> wp.uint32(28))
        now = base + low_of(head)
        column = column_of(head)
        row = row_of(head)
        if timed <= wp.int64(0) and kind != 14:
            if opened != wp.uint32(0):
                opened = wp.uint32(0)
            else:
                untimed += wp.int64(1)
                if kind == 12 or kind == 13:
                    opened = word
        elif kind >= 10 and kind <= 13:
            if n > last:
                break
            if now > limit_us:
                next_us = now
                break
            if kind < 12:
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
        elif kind == 14:
            newest = wp.int64(head & wp.uint32(0xFFFFFFF))
            # after a gap (-1) the time before it still counts, for the turns
            if timed == wp.int64(0):
                high = newest
            timed = wp.int64(1)
            loop = turns_of(loop, high, newest)
            high = newest
            base = time_of(loop, high)
        elif kind == 9:
            if m >= last_trigger:
                break
            if now > limit_us:
                next_us = now
                break
            channel = int((head >> wp.uint32(8)) & wp.uint32(31))
            put_trigger(m, now * wp.int64(1000), channel, int(head & wp.uint32(1)), to)
            m += 1
        elif kind != 6 and kind != 7 and kind != 15:
            unknown += wp.int64(1)
        i += 1
    to.state[0] = timed
    to.state[1] = high
    to.state[2] = loop
    to.state[3] = outside
    to.state[4] = untimed
    to.state[5] = unknown
    to.state[6] = wp.int64(opened)
    report(i, n, m, next_us, to)
