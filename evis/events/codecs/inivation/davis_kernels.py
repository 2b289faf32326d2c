"""Decodes DAVIS words to events, one after the other; the twin of
`evis.events.codecs.inivation.davis.Decoder.decode_words`."""

import warp as wp

from evis.events.codecs.inivation.davis import (
    APS_SPECIALS,
    IGNORED_CODE,
    OFF_CODE,
    ON_CODE,
    ROW,
    ROW_CODE,
    SAMPLE_CODE,
    SIDE_PIECES,
)
from evis.events.codecs.inivation.word_kernels import (
    clock_of,
    first_timed,
    is_trigger,
    keep_clock,
    trigger_channel,
    trigger_rises,
    wrapped,
)
from evis.events.codecs.inivation.words import (
    CODE_SHIFT,
    DATA_MASK,
    IMU_END,
    IMU_START,
    PIECE_CODE,
    RESET_WORD,
    SPECIAL_CODE,
    TIME_CODES,
    TIME_MASK,
    WRAP_CODE,
)
from evis.events.codecs.writing_kernels import Sink, Span, put_event, put_side, put_trigger, report

FIRST_APS, LAST_APS = APS_SPECIALS[0], APS_SPECIALS[-1]


@wp.func
def is_side(code: wp.int32, value: wp.int32):
    """Tells whether a word belongs to a frame or to an inertial sample."""
    if code == SAMPLE_CODE:
        return True
    if code == PIECE_CODE:
        return value < SIDE_PIECES << 8
    special = value == IMU_START or value == IMU_END or (value >= FIRST_APS and value <= LAST_APS)
    return code == SPECIAL_CODE and special


@wp.kernel(module="unique", enable_backward=False)
def decode_davis(
    # in
    words: wp.array(dtype=wp.uint16),
    span: Span,
    # out
    to: Sink,
):
    """Decodes DAVIS words to events, triggers and side words, one after the other, up to the limit or the end of the
    room.
    """
    clock = clock_of(to)
    row = int(to.state[ROW])
    now_ns = clock.now * wp.int64(1000)
    last = to.t.shape[0]
    last_trigger = to.trigger_t.shape[0]
    last_side = to.side_t.shape[0]
    n = wp.int32(0)
    m = wp.int32(0)
    k = wp.int32(0)
    next_us = wp.int64(-1)
    limit_us = span.limit_us
    width = span.width
    height = span.height
    i = int(span.start)
    end = words.shape[0]
    if clock.timed <= wp.int64(0):
        first = first_timed(words, i)
        clock.untimed += wp.int64(first - i)
        if first < end:
            clock.timed = wp.int64(1)
        i = first
    while i < end:
        word = int(words[i])
        code = word >> CODE_SHIFT
        value = word & DATA_MASK
        if code >= TIME_CODES:
            clock.now = clock.offset + wp.int64(word & TIME_MASK)
            now_ns = clock.now * wp.int64(1000)
        elif code == ROW_CODE:
            row = value
        elif code == WRAP_CODE:
            clock.offset = wrapped(clock.offset, value)
            clock.now = clock.offset
            now_ns = clock.now * wp.int64(1000)
        elif word == RESET_WORD:
            if k >= last_side:
                break
            clock.offset = wp.int64(0)
            clock.now = wp.int64(0)
            now_ns = wp.int64(0)
            clock.resets += wp.int64(1)
            put_side(k, clock.now, words[i], to)
            k += 1
        elif clock.now > limit_us:
            next_us = clock.now
            break
        elif code == OFF_CODE or code == ON_CODE:
            if n >= last:
                break
            if row >= height or value >= width:
                clock.outside += wp.int64(1)
            else:
                put_event(n, now_ns, value, row, wp.uint8(code & 1), to)
                n += 1
        elif code == SPECIAL_CODE and is_trigger(value):
            if m >= last_trigger:
                break
            put_trigger(m, now_ns, trigger_channel(value), trigger_rises(value), to)
            m += 1
        elif is_side(code, value):
            if k >= last_side:
                break
            put_side(k, clock.now, words[i], to)
            k += 1
        elif code != IGNORED_CODE:
            clock.unknown += wp.int64(1)
        i += 1
    keep_clock(clock, to)
    to.state[ROW] = wp.int64(row)
    report(i, n, m, next_us, to)
    to.out[4] = wp.int64(k)
