"""Decodes EVT2 and EVT2.1 words to events, one after the other; the twins of `evt2.Decoder.decode_words`."""

import warp as wp

from evis.events.codecs.mask_kernels import put_mask
from evis.events.codecs.prophesee.evt2 import (
    ADDRESS_MASK,
    CHANNEL_MASK,
    CHANNEL_SHIFT,
    HALF_TURN,
    HIGH,
    HIGH_MASK,
    HIGH_SHIFT,
    LOOP,
    LOW_MASK,
    LOW_SHIFT,
    MAX_LOOP,
    ON,
    OUTSIDE,
    PADDING,
    TIME_HIGH,
    TIMED,
    TRIGGER,
    TURN_SHIFT,
    TYPE_SHIFT,
    UNKNOWN,
    UNTIMED,
    X_SHIFT,
)
from evis.events.codecs.prophesee.run_kernels import evt2_run
from evis.events.codecs.writing_kernels import Sink, Span, bound_of, keep_inside, put_trigger, report

FIRST_PADDING = min(PADDING)


@wp.func
def time_of(loop: wp.int64, high: wp.int64):
    """Computes the time [us] of a TIME_HIGH word, after `loop` turns of its 28 bits."""
    return (loop << wp.int64(TURN_SHIFT)) + (high << wp.int64(HIGH_SHIFT))


@wp.func
def turns_of(loop: wp.int64, high: wp.int64, newest: wp.int64):
    """Counts the turns of the 28 bits when TIME_HIGH `newest` follows `high`."""
    if high >= newest + wp.int64(HALF_TURN) and loop < wp.int64(MAX_LOOP):
        return loop + wp.int64(1)
    return loop


@wp.func
def low_of(head: wp.uint32):
    """Reads the low part of the time [us]."""
    return wp.int64((head >> wp.uint32(LOW_SHIFT)) & wp.uint32(LOW_MASK))


@wp.func
def column_of(head: wp.uint32):
    """Reads the pixel's column, or that of the first of a vector."""
    return int((head >> wp.uint32(X_SHIFT)) & wp.uint32(ADDRESS_MASK))


@wp.func
def row_of(head: wp.uint32):
    """Reads the pixel's row."""
    return int(head & wp.uint32(ADDRESS_MASK))


@wp.func
def newest_of(head: wp.uint32):
    """Reads the time of a TIME_HIGH word."""
    return wp.int64(head & wp.uint32(HIGH_MASK))


@wp.func
def channel_of(head: wp.uint32):
    """Reads the channel of a trigger."""
    return int((head >> wp.uint32(CHANNEL_SHIFT)) & wp.uint32(CHANNEL_MASK))


def make_decode(vectors: bool) -> wp.Kernel:
    """Makes the kernel that decodes EVT2 or EVT2.1.

    vectors: EVT2.1, whose 64-bit words are an EVT2 word above a mask of 32 pixels; else EVT2.
    """
    word_type = wp.uint64 if vectors else wp.uint32
    per_word = 32 if vectors else 1

    @wp.func
    def head_of(word: word_type):
        """Reads the part of a word that is an EVT2 word."""
        if wp.static(vectors):
            return wp.uint32(word >> wp.uint64(32))
        else:
            return word

    @wp.kernel(module="unique", enable_backward=False)
    def decode(
        # in
        words: wp.array(dtype=word_type),
        span: Span,
        # out
        to: Sink,
    ):
        """Decodes EVT2 or EVT2.1 words to events and triggers, one after the other, up to the limit."""
        timed = to.state[TIMED]
        high = to.state[HIGH]
        loop = to.state[LOOP]
        outside = to.state[OUTSIDE]
        untimed = to.state[UNTIMED]
        unknown = to.state[UNKNOWN]
        base = time_of(loop, high)
        # stop while the events of a word still fit
        last = to.t.shape[0] - wp.static(per_word)
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
            head = head_of(words[i])
            kind = int(head >> wp.uint32(TYPE_SHIFT))
            if timed <= wp.int64(0) and kind != TIME_HIGH:
                untimed += wp.int64(1)
            elif kind <= ON:
                if n > last:
                    break
                now = base + low_of(head)
                if now > limit_us:
                    next_us = now
                    break
                first = n
                if wp.static(vectors):
                    column = column_of(head)
                    row = row_of(head)
                    mask = wp.uint32(words[i] & wp.uint64(0xFFFFFFFF))
                    n = put_mask(n, now * wp.int64(1000), column, row, wp.uint8(kind), mask, to)
                    if row >= rows or column + 32 > columns:
                        met = n
                        n = keep_inside(first, met, columns, rows, to)
                        outside += wp.int64(met - n)
                else:
                    # all words up to the next TIME_HIGH at once, where none of them can be later than the limit
                    stop = wp.where(base + wp.int64(LOW_MASK) <= limit_us, wp.min(end, i + last - n + 1), i + 1)
                    after = evt2_run(words, i, stop, base, n, to)
                    n = keep_inside(first, first + after - i, columns, rows, to)
                    outside += wp.int64(after - i - n + first)
                    i = after - 1
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
                now = base + low_of(head)
                if now > limit_us:
                    next_us = now
                    break
                put_trigger(m, now * wp.int64(1000), channel_of(head), int(head & wp.uint32(1)), to)
                m += 1
            elif kind < FIRST_PADDING:
                unknown += wp.int64(1)
            i += 1
        to.state[TIMED] = timed
        to.state[HIGH] = high
        to.state[LOOP] = loop
        to.state[OUTSIDE] = outside
        to.state[UNTIMED] = untimed
        to.state[UNKNOWN] = unknown
        report(i, n, m, next_us, to)

    return decode


decode_evt2 = make_decode(vectors=False)
decode_evt21 = make_decode(vectors=True)
