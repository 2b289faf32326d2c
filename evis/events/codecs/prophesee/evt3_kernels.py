"""EVT3 words to events, one after the other; the twin of `evis.events.codecs.prophesee.evt3.Decoder.decode_words`."""

import warp as wp

from evis.events.codecs.prophesee.run_kernels import evt3_run, keep_inside, put_vector
from evis.events.codecs.writing_kernels import Sink, bound_of, put_event, put_trigger, report


@wp.func
def start_of(loop: wp.int64, high: wp.int32):
    """Time [us] at which a TIME_HIGH begins, after `loop` turns."""
    return (loop << wp.int64(24)) + wp.int64(high << 12)


@wp.func
def latest_of(limit_us: wp.int64, since: wp.int64):
    """The last TIME_LOW that is not later than the limit: -1 for none."""
    return int(wp.clamp(limit_us - since, wp.int64(-1), wp.int64(4096)))


@wp.kernel(module="unique", enable_backward=False)
def decode_evt3(
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
    high = int(to.state[1])
    low = int(to.state[2])
    loop = to.state[3]
    row = int(to.state[4])
    base = int(to.state[5])
    sign = wp.uint8(to.state[6])
    outside = to.state[7]
    untimed = to.state[8]
    unknown = to.state[9]
    # a vector writes 12 places: stop while they still fit
    last = to.t.shape[0] - 12
    last_trigger = to.trigger_t.shape[0]
    n = wp.int32(0)
    m = wp.int32(0)
    next_us = wp.int64(-1)
    i = int(start)
    end = words.shape[0]
    columns = bound_of(width)
    rows = bound_of(height)
    while timed <= wp.int64(0) and i < end:
        if int(words[i]) >> 12 == 8:
            # after a gap (-1) the time before it still counts, for the turns
            if timed == wp.int64(0):
                high = int(words[i]) & 0xFFF
            timed = wp.int64(1)
        else:
            untimed += wp.int64(1)
            i += 1
    # times are `since` + the low part
    since = start_of(loop, high)
    latest = latest_of(limit_us, since)
    while i < end:
        if n > last:
            break
        word = int(words[i])
        kind = word >> 12
        value = word & 0xFFF
        if kind == 2:
            if low > latest:
                next_us = since + wp.int64(low)
                break
            to.state[2] = wp.int64(low)
            to.state[4] = wp.int64(row)
            # each word gives one event at most
            stop = wp.min(end, i + last - n + 1)
            i = evt3_run(words, i, stop, since, high, latest, n, to)
            met = int(to.out[1])
            kept = keep_inside(n, met, columns, rows, to)
            outside += wp.int64(met - kept)
            n = kept
            low = int(to.state[2])
            row = int(to.state[4])
            continue
        if kind == 0:
            row = value & 0x7FF
        elif kind == 3:
            base = value & 0x7FF
            sign = wp.uint8(value >> 11)
        elif kind == 4 or kind == 5:
            if low > latest:
                next_us = since + wp.int64(low)
                break
            now_ns = (since + wp.int64(low)) * wp.int64(1000)
            pixels = wp.where(kind == 4, 12, 8)
            value = value & ((1 << pixels) - 1)
            if row < rows and base + 12 <= columns:
                n = put_vector(n, now_ns, base, row, sign, value, to)
            else:
                column = base
                while value != 0:
                    pixel = column & 0xFFFF
                    if (value & 1) != 0:
                        if row < rows and pixel < columns:
                            put_event(n, now_ns, pixel, row, sign, to)
                            n += 1
                        else:
                            outside += wp.int64(1)
                    value = value >> 1
                    column += 1
            base = (base + pixels) & 0xFFFF
        elif kind == 6:
            low = value
        elif kind == 8:
            if high >= value + 2048:
                loop += wp.int64(1)
            if high != value:
                low = 0
                high = value
                since = start_of(loop, high)
                latest = latest_of(limit_us, since)
        elif kind == 10:
            if m >= last_trigger:
                break
            if low > latest:
                next_us = since + wp.int64(low)
                break
            now_ns = (since + wp.int64(low)) * wp.int64(1000)
            put_trigger(m, now_ns, (value >> 8) & 15, value & 1, to)
            m += 1
        elif kind != 7 and kind < 14:
            unknown += wp.int64(1)
        i += 1
    to.state[0] = timed
    to.state[1] = wp.int64(high)
    to.state[2] = wp.int64(low)
    to.state[3] = loop
    to.state[4] = wp.int64(row)
    to.state[5] = wp.int64(base)
    to.state[6] = wp.int64(sign)
    to.state[7] = outside
    to.state[8] = untimed
    to.state[9] = unknown
    report(i, n, m, next_us, to)
