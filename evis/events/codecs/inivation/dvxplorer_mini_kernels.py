"""Decodes DVXplorer Mini words to events, one after the other.

The twin of `evis.events.codecs.inivation.dvxplorer_mini.Decoder.decode_words`."""

import warp as wp

from evis.events.codecs.inivation.dvxplorer_mini import (
    BASE,
    BINNED,
    COLUMN,
    COLUMN_MASK,
    FIRST_MASK,
    FIRST_SHIFT,
    LAST,
    LOST_COLUMN,
    LOST_TIME,
    MAX_TURNS,
    NOW,
    OUTSIDE,
    REFERENCE,
    REFERENCE_BITS,
    REFERENCE_MASK,
    ROWS,
    SIGN_SHIFT,
    START_SHIFT,
    STEP_MASK,
    STEP_SHIFT,
    SUB,
    SUB_MASK,
    SUB_SHIFT,
    TIMED,
    TURNS,
    UNKNOWN,
    UNTIMED,
    USED,
    X,
)
from evis.events.codecs.mask_kernels import ones, put_rows
from evis.events.codecs.writing_kernels import Sink, Span, report


@wp.kernel(module="unique", enable_backward=False)
def decode_dvxplorer_mini(
    # in
    words: wp.array(dtype=wp.uint32),
    span: Span,
    # out
    to: Sink,
):
    """Decodes DVXplorer Mini words to events, one after the other, up to the limit or the end of the room."""
    timed = to.state[TIMED]
    base = to.state[BASE]
    turns = to.state[TURNS]
    newest = to.state[LAST]
    column = int(to.state[X])
    now = to.state[NOW]
    used = to.state[USED]
    used_sub = int(to.state[SUB])
    outside = to.state[OUTSIDE]
    untimed = to.state[UNTIMED]
    unknown = to.state[UNKNOWN]
    lost_time = to.state[LOST_TIME]
    lost_column = to.state[LOST_COLUMN]
    binned = int(to.state[BINNED])
    # a word gives up to 16 events: stop while they still fit
    last = to.t.shape[0] - 16
    n = wp.int32(0)
    next_us = wp.int64(-1)
    limit_us = span.limit_us
    width = span.width
    height = span.height
    i = int(span.start)
    end = words.shape[0]
    while i < end:
        word = words[i]
        value = int(word & wp.uint32(0x7FFFFFFF))
        if (word >> wp.uint32(31)) != wp.uint32(0):
            if column < 0:
                untimed += wp.int64(1)
            else:
                if n > last:
                    break
                if now > limit_us:
                    next_us = now
                    break
                row = ((value >> FIRST_SHIFT) & FIRST_MASK) * ROWS
                across = column
                if binned != 0 and across >= width:
                    across -= width
                for half in range(2):
                    mask = (value >> (ROWS * half)) & 0xFF
                    if mask != 0:
                        pixel = row + half * ((value >> STEP_SHIFT) & STEP_MASK) * ROWS
                        if binned != 0 and pixel >= height:
                            pixel -= height
                        sign = wp.uint8(1 - ((value >> (SIGN_SHIFT + half)) & 1))
                        before = n
                        n = put_rows(before, now * wp.int64(1000), across, pixel, sign, mask, width, height, to)
                        outside += wp.int64(ones(mask) - n + before)
        elif (value & COLUMN) != 0:
            lost = 0
            starts = (value >> START_SHIFT) & 1
            address = value & COLUMN_MASK
            sub = (value >> SUB_SHIFT) & SUB_MASK
            if timed <= wp.int64(0) or (starts == 0 and column < 0):
                untimed += wp.int64(1)
            elif starts == 1:
                if base == used and sub <= used_sub:
                    lost_time += wp.int64(1)
                    lost = 1
                else:
                    column = address
                    used = base
                    used_sub = sub
                    now = base * wp.int64(1000) + wp.int64(sub)
            elif address <= column:
                lost_column += wp.int64(1)
                lost = 1
            else:
                column = address
            if lost == 1:
                timed = wp.int64(-1)
                column = -1
                used = wp.int64(-1)
                used_sub = -1
        elif (value & REFERENCE) != 0:
            reference = wp.int64(value & REFERENCE_MASK)
            if reference < newest and turns < wp.int64(MAX_TURNS):
                turns += wp.int64(1)
            timed = wp.int64(1)
            newest = reference
            base = (turns << wp.int64(REFERENCE_BITS)) + reference
        elif value != 0:
            unknown += wp.int64(1)
        i += 1
    to.state[TIMED] = timed
    to.state[BASE] = base
    to.state[TURNS] = turns
    to.state[LAST] = newest
    to.state[X] = wp.int64(column)
    to.state[NOW] = now
    to.state[USED] = used
    to.state[SUB] = wp.int64(used_sub)
    to.state[OUTSIDE] = outside
    to.state[UNTIMED] = untimed
    to.state[UNKNOWN] = unknown
    to.state[LOST_TIME] = lost_time
    to.state[LOST_COLUMN] = lost_column
    report(i, n, 0, next_us, to)
