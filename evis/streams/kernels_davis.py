"""DAVIS words to events, one after the other; the twin of `evis.streams.davis.Decoder.decode_words`."""

import warp as wp

from evis.streams.kernels_inivation import first_timed, is_trigger, trigger_channel, trigger_rises, wrapped
from evis.streams.kernels_writing import put_event, put_trigger, report


@wp.kernel(module="unique", enable_backward=False)
def decode_davis(
    # in
    words: wp.array(dtype=wp.uint16),
    start: wp.int64,
    limit_us: wp.int64,
    width: int,
    height: int,
    # out
    state: wp.array(dtype=wp.int64),
    out: wp.array(dtype=wp.int64),
    t: wp.array(dtype=wp.int64),
    x: wp.array(dtype=wp.uint16),
    y: wp.array(dtype=wp.uint16),
    p: wp.array(dtype=wp.uint8),
    trigger_t: wp.array(dtype=wp.int64),
    trigger_id: wp.array(dtype=wp.uint8),
    trigger_value: wp.array(dtype=wp.uint8),
    side_t: wp.array(dtype=wp.int64),
    side_word: wp.array(dtype=wp.uint16),
):
    timed = state[0]
    offset = state[1]
    now = state[2]
    outside = state[3]
    untimed = state[4]
    unknown = state[5]
    resets = state[6]
    row = int(state[9])
    now_ns = now * wp.int64(1000)
    last = t.shape[0]
    last_trigger = trigger_t.shape[0]
    last_side = side_t.shape[0]
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
            side_t[k] = now
            side_word[k] = words[i]
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
                put_event(n, now_ns, value, row, wp.uint8(code & 1), t, x, y, p)
                n += 1
        elif code == 0 and is_trigger(value):
            if m >= last_trigger:
                break
            put_trigger(m, now_ns, trigger_channel(value), trigger_rises(value), trigger_t, trigger_id, trigger_value)
            m += 1
        elif code == 4 or (code == 5 and value < 0x400) or (code == 0 and value >= 5 and value < 16 and value != 6):
            if k >= last_side:
                break
            side_t[k] = now
            side_word[k] = words[i]
            k += 1
        elif code != 6:
            unknown += wp.int64(1)
        i += 1
    state[0] = timed
    state[1] = offset
    state[2] = now
    state[3] = outside
    state[4] = untimed
    state[5] = unknown
    state[6] = resets
    state[9] = wp.int64(row)
    report(i, n, m, next_us, out)
    out[4] = wp.int64(k)
