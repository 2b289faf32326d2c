"""Decodes DVS128 words to events, one after the other; the twin of `dvs128.Decoder.decode_words`."""

import warp as wp

from evis.events.codecs.inivation.dvs128 import (
    EDGE,
    OFFSET,
    OUTSIDE,
    PIXEL_MASK,
    RESET,
    RESETS,
    TIME_SHIFT,
    TURN_BITS,
    WRAP,
    X_SHIFT,
    Y_SHIFT,
)
from evis.events.codecs.inivation.word_kernels import LATEST_OFFSET
from evis.events.codecs.writing_kernels import Sink, Span, put_event, put_trigger, report

WRAP_BIT, RESET_BIT = WRAP.bit_length() - 1, RESET.bit_length() - 1


@wp.kernel(module="unique", enable_backward=False)
def decode_dvs128(
    # in
    words: wp.array(dtype=wp.uint32),
    span: Span,
    # out
    to: Sink,
):
    """Decodes DVS128 words to events and triggers, one after the other, up to the limit or the end of the room."""
    offset = to.state[OFFSET]
    outside = to.state[OUTSIDE]
    resets = to.state[RESETS]
    last = to.t.shape[0]
    last_trigger = to.trigger_t.shape[0]
    n = wp.int32(0)
    m = wp.int32(0)
    next_us = wp.int64(-1)
    limit_us = span.limit_us
    width = span.width
    height = span.height
    i = int(span.start)
    end = words.shape[0]
    while i < end:
        word = words[i]
        if (word >> wp.uint32(WRAP_BIT)) != wp.uint32(0):
            offset = wp.min(offset + (wp.int64(1) << wp.int64(TURN_BITS)), LATEST_OFFSET)
        elif (word >> wp.uint32(RESET_BIT)) != wp.uint32(0):
            offset = wp.int64(0)
            resets += wp.int64(1)
        else:
            now = offset + wp.int64(word >> wp.uint32(TIME_SHIFT))
            if now > limit_us:
                next_us = now
                break
            address = int(word & wp.uint32(0xFFFF))
            if address >= EDGE:
                if m >= last_trigger:
                    break
                put_trigger(m, now * wp.int64(1000), 0, 1, to)
                m += 1
            else:
                if n >= last:
                    break
                column = PIXEL_MASK - ((address >> X_SHIFT) & PIXEL_MASK)
                row = PIXEL_MASK - (address >> Y_SHIFT)
                if row >= height or column >= width:
                    outside += wp.int64(1)
                else:
                    put_event(n, now * wp.int64(1000), column, row, wp.uint8(1 - (address & 1)), to)
                    n += 1
        i += 1
    to.state[OFFSET] = offset
    to.state[OUTSIDE] = outside
    to.state[RESETS] = resets
    report(i, n, m, next_us, to)
