"""DVXplorer words to events, one after the other; the twin of `dvxplorer.Decoder.decode_words`."""

import warp as wp

from evis.events.codecs.inivation.word_kernels import first_timed, is_trigger, trigger_channel, trigger_rises, wrapped
from evis.events.codecs.mask_kernels import ones, put_rows
from evis.events.codecs.writing_kernels import Sink, put_trigger, report


@wp.kernel(module="unique", enable_backward=False)
def decode_dvxplorer(
    # in
    words: wp.array(dtype=wp.uint16),
    start: wp.int64,
    limit_us: wp.int64,
    width: int,
    height: int,
    # out
    to: Sink,
):
    timed = to.state[0]
    offset = to.state[1]
    now = to.state[2]
    outside = to.state[3]
    untimed = to.state[4]
    unknown = to.state[5]
    resets = to.state[6]
    column = int(to.state[9])
    row1 = int(to.state[10])
    row2 = int(to.state[11])
    binned = int(to.state[12])
    now_ns = now * wp.int64(1000)
    # a word gives up to 8 events: stop while they still fit
    last = to.t.shape[0] - 8
    last_trigger = to.trigger_t.shape[0]
    last_side = to.side_t.shape[0]
    n = wp.int32(0)
    m = wp.int32(0)
    k = wp.int32(0)
    next_us = wp.int64(-1)
    i = int(start)
    end = words.shape[0]
    if timed <= wp.int64(0):
        first = first_timed(words, i)
        untimed += wp.int64(first - i)
        if first < end:
            timed = wp.int64(1)
        i = first
    while i < end:
        word = int(words[i])
        code = word >> 12
        value = word & 0xFFF
        if code >= 8:
            now = offset + wp.int64(word & 0x7FFF)
            now_ns = now * wp.int64(1000)
        elif code == 1:
            column = value & 0x3FF
            if binned != 0 and column >= width:
                column -= width
        elif code == 4:
            row1 = value & 0x3F
            row2 = row1 + ((value >> 6) & 31)
            if (value & 0x800) != 0:
                row2 = row1 - ((value >> 6) & 31)
            row1 = row1 * 8
            row2 = row2 * 8
            if binned != 0:
                row1 = wp.where(row1 >= height, row1 - height, row1)
                row2 = wp.where(row2 >= height, row2 - height, row2)
        elif code == 7:
            offset = wrapped(offset, value)
            now = offset
            now_ns = now * wp.int64(1000)
        elif word == 1:
            if k >= last_side:
                break
            offset = wp.int64(0)
            now = wp.int64(0)
            now_ns = wp.int64(0)
            resets += wp.int64(1)
            to.side_t[k] = now
            to.side_word[k] = words[i]
            k += 1
        elif now > limit_us:
            next_us = now
            break
        elif code == 2 or code == 3:
            if n > last:
                break
            row = row1
            if code == 2:
                row = row2
            sign = wp.uint8(1 - ((value >> 8) & 1))
            mask = value & 0xFF
            before = n
            n = put_rows(before, now_ns, column, row, sign, mask, width, height, to)
            outside += wp.int64(ones(mask) - n + before)
        elif code == 0 and is_trigger(value):
            if m >= last_trigger:
                break
            put_trigger(m, now_ns, trigger_channel(value), trigger_rises(value), to)
            m += 1
        elif word == 5 or word == 7 or (word >> 8) == 0x50 or (word >> 8) == 0x53:
            if k >= last_side:
                break
            to.side_t[k] = now
            to.side_word[k] = words[i]
            k += 1
        else:
            unknown += wp.int64(1)
        i += 1
    to.state[0] = timed
    to.state[1] = offset
    to.state[2] = now
    to.state[3] = outside
    to.state[4] = untimed
    to.state[5] = unknown
    to.state[6] = resets
    to.state[9] = wp.int64(column)
    to.state[10] = wp.int64(row1)
    to.state[11] = wp.int64(row2)
    report(i, n, m, next_us, to)
    to.out[4] = wp.int64(k)
