"""DVXplorer Mini words to events, one after the other.

The twin of `evis.events.codecs.inivation.dvxplorer_mini.Decoder.decode_words`."""

import warp as wp

from evis.events.codecs.mask_kernels import ones, put_rows
from evis.events.codecs.writing_kernels import Sink, report


@wp.kernel(module="unique", enable_backward=False)
def decode_dvxplorer_mini(
    # in
    words: wp.array(dtype=wp.uint32),
    start: wp.int64,
    limit_us: wp.int64,
    width: int,
    height: int,
    # out
    to: Sink,
):
    timed = to.state[0]
    base = to.state[1]
    turns = to.state[2]
    newest = to.state[3]
    column = int(to.state[4])
    now = to.state[5]
    used = to.state[6]
    used_sub = int(to.state[7])
    outside = to.state[8]
    untimed = to.state[9]
    unknown = to.state[10]
    lost_time = to.state[11]
    lost_column = to.state[12]
    binned = int(to.state[13])
    # a word gives up to 16 events: stop while they still fit
    last = to.t.shape[0] - 16
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
                across = column
                if binned != 0 and across >= width:
                    across -= width
                for half in range(2):
                    mask = (value >> (8 * half)) & 0xFF
                    if mask != 0:
                        pixel = row + half * ((value >> 26) & 31) * 8
                        if binned != 0 and pixel >= height:
                            pixel -= height
                        sign = wp.uint8(1 - ((value >> (16 + half)) & 1))
                        before = n
                        n = put_rows(before, now * wp.int64(1000), across, pixel, sign, mask, width, height, to)
                        outside += wp.int64(ones(mask) - n + before)
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
    to.state[0] = timed
    to.state[1] = base
    to.state[2] = turns
    to.state[3] = newest
    to.state[4] = wp.int64(column)
    to.state[5] = now
    to.state[6] = used
    to.state[7] = wp.int64(used_sub)
    to.state[8] = outside
    to.state[9] = untimed
    to.state[10] = unknown
    to.state[11] = lost_time
    to.state[12] = lost_column
    report(i, n, 0, next_us, to)
