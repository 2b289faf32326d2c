"""Decodes DVXplorer words to events, one after the other; the twin of
`evis.events.codecs.inivation.dvxplorer.Decoder.decode_words`."""

import warp as wp

from evis.events.codecs.inivation.dvxplorer import (
    BINNED,
    COLUMN,
    COLUMN_CODE,
    COLUMN_MASK,
    GROUP_MASK,
    GROUPS_CODE,
    MASK1_CODE,
    MASK2_CODE,
    OFF_BIT,
    ROW1,
    ROW2,
    SIDE_PIECES,
    STEP_MASK,
    STEP_SHIFT,
    STEPS_BACK,
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
from evis.events.codecs.mask_kernels import ones, put_rows
from evis.events.codecs.writing_kernels import Sink, Span, put_side, put_trigger, report

SAMPLE_PIECE, RANGE_PIECE = (PIECE_CODE << 4 | piece for piece in SIDE_PIECES)


@wp.kernel(module="unique", enable_backward=False)
def decode_dvxplorer(
    # in
    words: wp.array(dtype=wp.uint16),
    span: Span,
    # out
    to: Sink,
):
    """Decodes DVXplorer words to events, triggers and side words, one after the other, up to the limit."""
    clock = clock_of(to)
    column = int(to.state[COLUMN])
    row1 = int(to.state[ROW1])
    row2 = int(to.state[ROW2])
    binned = int(to.state[BINNED])
    now_ns = clock.now * wp.int64(1000)
    # a word gives up to 8 events: stop while they still fit
    last = to.t.shape[0] - 8
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
        elif code == COLUMN_CODE:
            column = value & COLUMN_MASK
            if binned != 0 and column >= width:
                column -= width
        elif code == GROUPS_CODE:
            row1 = value & GROUP_MASK
            row2 = row1 + ((value >> STEP_SHIFT) & STEP_MASK)
            if (value & STEPS_BACK) != 0:
                row2 = row1 - ((value >> STEP_SHIFT) & STEP_MASK)
            row1 = row1 * 8
            row2 = row2 * 8
            if binned != 0:
                row1 = wp.where(row1 >= height, row1 - height, row1)
                row2 = wp.where(row2 >= height, row2 - height, row2)
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
        elif code == MASK1_CODE or code == MASK2_CODE:
            if n > last:
                break
            row = row1
            if code == MASK2_CODE:
                row = row2
            sign = wp.uint8(1 - ((value >> OFF_BIT) & 1))
            mask = value & 0xFF
            before = n
            n = put_rows(before, now_ns, column, row, sign, mask, width, height, to)
            clock.outside += wp.int64(ones(mask) - n + before)
        elif code == SPECIAL_CODE and is_trigger(value):
            if m >= last_trigger:
                break
            put_trigger(m, now_ns, trigger_channel(value), trigger_rises(value), to)
            m += 1
        elif word == IMU_START or word == IMU_END or (word >> 8) == SAMPLE_PIECE or (word >> 8) == RANGE_PIECE:
            if k >= last_side:
                break
            put_side(k, clock.now, words[i], to)
            k += 1
        else:
            clock.unknown += wp.int64(1)
        i += 1
    keep_clock(clock, to)
    to.state[COLUMN] = wp.int64(column)
    to.state[ROW1] = wp.int64(row1)
    to.state[ROW2] = wp.int64(row2)
    report(i, n, m, next_us, to)
    to.out[4] = wp.int64(k)
