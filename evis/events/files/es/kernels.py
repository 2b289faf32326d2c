"""Decodes Event Stream files as a Warp CPU kernel (dim = 1); the loop in `decoder` is its twin."""

import warp as wp

from evis.warp_start import start_warp

start_warp()


@wp.kernel(module="unique", enable_backward=False)
def decode_es(
    # in
    data: wp.array(dtype=wp.uint8),
    atis: int,
    # out
    out: wp.array(dtype=wp.int64),
    t: wp.array(dtype=wp.int64),
    x: wp.array(dtype=wp.uint16),
    y: wp.array(dtype=wp.uint16),
    p: wp.array(dtype=wp.uint8),
):
    """Decodes the bytes of an Event Stream to events; out = bytes used, events, exposures, time [us]."""
    now = out[3]
    at = wp.int32(0)
    n = wp.int32(0)
    exposures = wp.int64(0)
    end = data.shape[0]
    while at < end:
        first = int(data[at])
        if atis == 1 and first >= 252:
            now += wp.int64(63 * (first & 3))
            at += 1
        elif atis == 0 and first >= 254:
            now += wp.int64(127 * (first & 1))
            at += 1
        elif at + 5 > end:
            break
        else:
            if atis == 1:
                now += wp.int64(first >> 2)
                sign = (first >> 1) & 1
            else:
                now += wp.int64(first >> 1)
                sign = first & 1
            if atis == 1 and (first & 1) == 1:
                exposures += wp.int64(1)
            else:
                t[n] = now
                x[n] = wp.uint16(int(data[at + 1]) | (int(data[at + 2]) << 8))
                y[n] = wp.uint16(int(data[at + 3]) | (int(data[at + 4]) << 8))
                p[n] = wp.uint8(sign)
                n += 1
            at += 5
    out[0] = wp.int64(at)
    out[1] = wp.int64(n)
    out[2] = exposures
    out[3] = now
