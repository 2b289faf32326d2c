"""DAVIS words to events, one after the other; the twin of `evis.streams.davis.Decoder.decode_words`."""

import warp as wp


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
    while timed <= wp.int64(0) and i < end:
        word = int(words[i])
        if word >= 0x7000 or word == 1:
            timed = wp.int64(1)
        else:
            untimed += wp.int64(1)
            i += 1
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
            offset = wp.min(offset + wp.int64(value << 15), wp.int64(4503599627370496))
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
                t[n] = now_ns
                x[n] = wp.uint16(value)
                y[n] = wp.uint16(row)
                p[n] = wp.uint8(code & 1)
                n += 1
        elif code == 0 and ((value >= 2 and value <= 4) or value == 16 or value == 17):
            if m >= last_trigger:
                break
            trigger_t[m] = now_ns
            channel = 0
            if value == 4:
                channel = 2
            elif value >= 16:
                channel = 1
            rises = 0
            if value == 3 or value == 4 or value == 17:
                rises = 1
            trigger_id[m] = wp.uint8(channel)
            trigger_value[m] = wp.uint8(rises)
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
    out[0] = wp.int64(i)
    out[1] = wp.int64(n)
    out[2] = wp.int64(m)
    out[3] = next_us
    out[4] = wp.int64(k)
