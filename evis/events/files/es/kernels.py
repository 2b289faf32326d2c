"""Decodes Event Stream files as a Warp CPU kernel (dim = 1); the loop in `decoder` is its twin."""

import warp as wp

from evis.events.files.es.layout import EVENT_BYTES
from evis.warp_start import start_warp

start_warp()


@wp.kernel(module="unique", enable_backward=False)
def decode_es(
    # in
    data: wp.array(dtype=wp.uint8),
    shift: int,
    longest: int,
    # out
    out: wp.array(dtype=wp.int64),
    t: wp.array(dtype=wp.int64),
    x: wp.array(dtype=wp.uint16),
    y: wp.array(dtype=wp.uint16),
    p: wp.array(dtype=wp.uint8),
):
    """Decodes the bytes of an Event Stream to events.

    Args:
        data: bytes of the stream, from the first byte of an event on [n].
        shift: bits below the time in the first byte of an event; see `layout`.
        longest: time of a first byte that stands for a pause [us].
        out: the time before the first byte [us] in place 3; gets bytes used, events, exposures and the time [us].
        t: times [us], with room for n / 5 events, as the other columns.
        x: pixel columns.
        y: pixel rows.
        p: polarities, 1 = ON.
    """
    now = out[3]
    at = wp.int32(0)
    n = wp.int32(0)
    exposures = wp.int64(0)
    end = data.shape[0]
    pause = longest << shift
    below = (1 << shift) - 1
    marked = below >> 1
    while at < end:
        first = int(data[at])
        if first >= pause:
            now += wp.int64(longest * (first & below))
            at += 1
        elif at + EVENT_BYTES > end:
            break
        else:
            now += wp.int64(first >> shift)
            if (first & marked) != 0:
                exposures += wp.int64(1)
            else:
                t[n] = now
                x[n] = wp.uint16(int(data[at + 1]) | (int(data[at + 2]) << 8))
                y[n] = wp.uint16(int(data[at + 3]) | (int(data[at + 4]) << 8))
                p[n] = wp.uint8((first >> (shift - 1)) & 1)
                n += 1
            at += EVENT_BYTES
    out[0] = wp.int64(at)
    out[1] = wp.int64(n)
    out[2] = exposures
    out[3] = now
