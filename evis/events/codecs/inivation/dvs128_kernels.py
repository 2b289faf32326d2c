"""DVS128 words to events, one after the other; the twin of `dvs128.Decoder.decode_words`."""

import warp as wp

from evis.events.codecs.writing_kernels import Sink, put_event, put_trigger, report


@wp.kernel(module="unique", enable_backward=False)
def decode_dvs128(
    # in
    words: wp.array(dtype=wp.uint32),
    start: wp.int64,
    limit_us: wp.int64,
    width: int,
    height: int,
    # out
    to: Sink,
):
    offset = to.state[1]
    outside = to.state[2]
    resets = to.state[3]
    last = to.t.shape[0]
    last_trigger = to.trigger_t.shape[0]
    n = wp.int32(0)
    m = wp.int32(0)
    next_us = wp.int64(-1)
    i = int(start)
    end = words.shape[0]
    while i < end:
        word = words[i]
        if (word >> wp.uint32(31)) != wp.uint32(0):
            offset = wp.min(offset + wp.int64(16384), wp.int64(4503599627370496))
        elif (word >> wp.uint32(30)) != wp.uint32(0):
            offset = wp.int64(0)
            resets += wp.int64(1)
        else:
            now = offset + wp.int64(word >> wp.uint32(16))
            if now > limit_us:
                next_us = now
                break
            address = int(word & wp.uint32(0xFFFF))
            if address >= 0x8000:
                if m >= last_trigger:
                    break
                put_trigger(m, now * wp.int64(1000), 0, 1, to)
                m += 1
            else:
                if n >= last:
                    break
                column = 127 - ((address >> 1) & 127)
                row = 127 - (address >> 8)
                if row >= height or column >= width:
                    outside += wp.int64(1)
                else:
                    put_event(n, now * wp.int64(1000), column, row, wp.uint8(1 - (address & 1)), to)
                    n += 1
        i += 1
    to.state[1] = offset
    to.state[2] = outside
    to.state[3] = resets
    report(i, n, m, next_us, to)
