"""DVXplorer Mini words to events, one after the other.

The twin of `evis.streams.dvxplorer_mini.Decoder.decode_words`."""

import warp as wp

from evis.streams.kernels_writing import put_event, report


@wp.kernel(module="unique", enable_backward=False)
def decode_dvxplorer_mini(
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
    base = state[1]
    turns = state[2]
    newest = state[3]
    column = int(state[4])
    now = state[5]
    used = state[6]
    used_sub = int(state[7])
    outside = state[8]
    untimed = state[9]
    unknown = state[10]
    lost_time = state[11]
    lost_column = state[12]
    # a word gives up to 16 events: stop while they still fit
    last = t.shape[0] - 16
    n = wp.int32(0)
    next_us = wp.int64(-1)
    i = int(start)
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
                row = ((value >> 18) & 63) * 8
                for half in range(2):
                    sign = wp.uint8(1 - ((value >> (16 + half)) & 1))
                    mask = (value >> (8 * half)) & 0xFF
                    pixel = row
                    if half == 1:
                        pixel = row + ((value >> 26) & 31) * 8
                    while mask != 0:
                        if (mask & 1) != 0:
                            if pixel >= height or column >= width:
                                outside += wp.int64(1)
                            else:
                                put_event(n, now * wp.int64(1000), column, pixel, sign, t, x, y, p)
                                n += 1
                        mask = mask >> 1
                        pixel += 1
        elif (value & 0x04000000) != 0:
            lost = 0
            starts = (value >> 21) & 1
            address = value & 0x3FF
            sub = (value >> 11) & 0x3FF
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
        elif (value & 0x08000000) != 0:
            reference = wp.int64(value & 0x3FFFFF)
            if reference < newest and turns < wp.int64(100000):
                turns += wp.int64(1)
            timed = wp.int64(1)
            newest = reference
            base = (turns << wp.int64(22)) + reference
        elif value != 0:
            unknown += wp.int64(1)
        i += 1
    state[0] = timed
    state[1] = base
    state[2] = turns
    state[3] = newest
    state[4] = wp.int64(column)
    state[5] = now
    state[6] = used
    state[7] = wp.int64(used_sub)
    state[8] = outside
    state[9] = untimed
    state[10] = unknown
    state[11] = lost_time
    state[12] = lost_column
    report(i, n, 0, next_us, out)
