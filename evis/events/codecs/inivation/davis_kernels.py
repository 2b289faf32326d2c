"""DAVIS words to events, one after the other; the twin of `evis.events.codecs.inivation.davis.Decoder.decode_words`."""

import warp as wp

from evis.events.codecs.inivation.word_kernels import first_timed, is_trigger, trigger_channel, trigger_rises, wrapped
from evis.events.codecs.writing_kernels import Sink, put_event, put_trigger, report


@wp.kernel(module="unique", enable_backward=False)
def decode_davis(
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
    row = int(to.state[9])
    now_ns = now * wp.int64(1000)
    last = to.t.shape[0]
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
            row = value
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
            if n >= last:
                break
            if row >= height or value >= width:
                outside += wp.int64(1)
            else:
                put_event(n, now_ns, value, row, wp.uint8(code & 1), to)
                n += 1
        elif code == 0 and is_trigger(value):
            if m >= last_trigger:
                break
            put_trigger(m, now_ns, trigger_channel(value), trigger_rises(value), to)
            m += 1
        elif code == 4 or (code == 5 and value < 0x400) or (code == 0 and value >= 5 and value < 16 and value != 6):
            if k >= last_side:
                break
            to.side_t[k] = now
            to.side_word[k] = words[i]
            k += 1
        elif code != 6:
            unknown += wp.int64(1)
        i += 1
    to.state[0] = timed
    to.state[1] = offset
    to.state[2] = now
    to.state[3] = outside
    to.state[4] = untimed
    to.state[5] = unknown
    to.state[6] = resets
    to.state[9] = wp.int64(row)
    report(i, n, m, next_us, to)
    to.out[4] = wp.int64(k)
