"""EVT2 words to events, one after the other; the twin of `evis.streams.evt2.Decoder.decode_words`."""

import warp as wp


@wp.kernel(module="unique", enable_backward=False)
def decode_evt2(
    # in
    words: wp.array(dtype=wp.uint32),
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
):
    timed = state[0]
    high = state[1]
    loop = state[2]
    outside = state[3]
    untimed = state[4]
    unknown = state[5]
    base = (loop << wp.int64(34)) + (high << wp.int64(6))
    capacity = t.shape[0]
    last_trigger = trigger_t.shape[0]
    n = wp.int32(0)
    m = wp.int32(0)
    next_us = wp.int64(-1)
    i = int(start)
    end = words.shape[0]
    while i < end:
        word = words[i]
        kind = int(word >> wp.uint32(28))
        if timed <= wp.int64(0) and kind != 8:
            untimed += wp.int64(1)
        elif kind < 2:
            if n >= capacity:
                break
            now = base + wp.int64((word >> wp.uint32(22)) & wp.uint32(63))
            if now > limit_us:
                next_us = now
                break
            column = int((word >> wp.uint32(11)) & wp.uint32(0x7FF))
            row = int(word & wp.uint32(0x7FF))
            if (height > 0 and row >= height) or (width > 0 and column >= width):
                outside += wp.int64(1)
            else:
                t[n] = now * wp.int64(1000)
                x[n] = wp.uint16(column)
                y[n] = wp.uint16(row)
                p[n] = wp.uint8(kind)
                n += 1
        elif kind == 8:
            value = wp.int64(word & wp.uint32(0xFFFFFFF))
            # after a gap (-1) the time before it still counts, for the turns
            if timed == wp.int64(0):
                high = value
            timed = wp.int64(1)
            if high >= value + (wp.int64(1) << wp.int64(27)) and loop < wp.int64(262144):
                loop += wp.int64(1)
            high = value
            base = (loop << wp.int64(34)) + (high << wp.int64(6))
        elif kind == 10:
            if m >= last_trigger:
                break
            now = base + wp.int64((word >> wp.uint32(22)) & wp.uint32(63))
            if now > limit_us:
                next_us = now
                break
            trigger_t[m] = now * wp.int64(1000)
            trigger_id[m] = wp.uint8((word >> wp.uint32(8)) & wp.uint32(31))
            trigger_value[m] = wp.uint8(word & wp.uint32(1))
            m += 1
        elif kind < 14:
            unknown += wp.int64(1)
        i += 1
    state[0] = timed
    state[1] = high
    state[2] = loop
    state[3] = outside
    state[4] = untimed
    state[5] = unknown
    out[0] = wp.int64(i)
    out[1] = wp.int64(n)
    out[2] = wp.int64(m)
    out[3] = next_us
