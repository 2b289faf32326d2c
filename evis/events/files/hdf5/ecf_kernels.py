"""Decodes ECF chunks in a sequential Warp CPU kernel (dim = 1); the plain loop of `ecf` is the reference.

The parts of a chunk follow each other, each read by a function of its own: from byte `at` on, into its columns. It
returns the byte behind the part, or -1 where the data end early. The columns have five places more than events.
"""

import warp as wp

from evis.events.files.hdf5.ecf_layout import (
    COLUMN_GROUP_BYTES,
    EVENT_GROUP_BYTES,
    GROUP,
    HEAD_BYTES,
    LAST_SHIFT,
    MASK_BITS,
    POLARITY_COUNT_BITS,
    ROW_COUNT_BITS,
    SIDE_MASK,
    STEP_BITS,
    STEP_MAX,
    X_SHIFT,
    Y_SHIFT,
)
from evis.warp_start import start_warp

start_warp()

Bytes = wp.array(dtype=wp.uint8)
U16 = wp.array(dtype=wp.uint16)
ROW_COUNT_MAX, POLARITY_COUNT_MAX = (1 << ROW_COUNT_BITS) - 1, (1 << POLARITY_COUNT_BITS) - 1


@wp.func
def half(data: Bytes, at: int):
    """Reads the little-endian u16 at a byte, 0 behind the end."""
    if at + 2 > data.shape[0]:
        return 0
    return int(data[at]) | (int(data[at + 1]) << 8)


@wp.func
def word(data: Bytes, at: int):
    """Reads the little-endian u32 at a byte."""
    return half(data, at) | (half(data, at + 2) << 16)


@wp.func
def read_times(data: Bytes, at: int, n: int, t0: wp.int64, t: wp.array(dtype=wp.int64)):
    """Reads runs of events with one time: step and count, with longer steps and counts behind a 15."""
    now = t0
    i = wp.int32(0)
    jump = wp.int64(0)
    shift = wp.int32(0)
    while i < n:
        if at >= data.shape[0]:
            return -1
        step = int(data[at]) >> STEP_BITS
        count = int(data[at]) & STEP_MAX
        at += 1
        if step == STEP_MAX:
            if shift > LAST_SHIFT:
                return -1
            jump = jump | (wp.int64(count) << wp.int64(shift))
            shift += STEP_BITS
        else:
            if count == STEP_MAX:
                if at + 2 > data.shape[0]:
                    return -1
                count = half(data, at)
                at += 2
            now += jump + wp.int64(step)
            jump = wp.int64(0)
            shift = wp.int32(0)
            last = wp.min(i + count, n)
            for j in range(i, last):
                t[j] = now
            i = last
    return at


@wp.func
def read_packed_events(data: Bytes, at: int, n: int, x: U16, y: U16, p: Bytes):
    """Reads row, column and polarity of n events, packed by four into three words of 32 bits.

    Args:
        data: bytes of the chunk.
        at: place of the first word.
        n: events.
        x: gets pixel columns.
        y: gets pixel rows.
        p: gets polarities, 1 = ON.

    Returns:
        the place behind the words, -1 where the data end early.
    """
    i = wp.int32(0)
    while i < n:
        if at + EVENT_GROUP_BYTES > data.shape[0]:
            return -1
        a = word(data, at)
        b = word(data, at + 4)
        c = word(data, at + 8)
        at += EVENT_GROUP_BYTES
        for k in range(GROUP):
            v = (a >> 8) & 0xFFFFFF
            if k == 1:
                v = (a & 0xFF) | (((b >> 16) & 0xFFFF) << 8)
            elif k == 2:
                v = (b & 0xFFFF) | (((c >> 24) & 0xFF) << 16)
            elif k == 3:
                v = c & 0xFFFFFF
            y[i + k] = wp.uint16((v >> Y_SHIFT) & SIDE_MASK)
            x[i + k] = wp.uint16((v >> X_SHIFT) & SIDE_MASK)
            p[i + k] = wp.uint8(v & 1)
        i += GROUP
    return at


@wp.func
def read_rows(data: Bytes, at: int, n: int, y: U16):
    """Reads runs of events in one row."""
    i = wp.int32(0)
    while i < n:
        if at + 2 > data.shape[0]:
            return -1
        run = half(data, at)
        at += 2
        count = run & ROW_COUNT_MAX
        if count == ROW_COUNT_MAX:
            if at + 2 > data.shape[0]:
                return -1
            count = half(data, at)
            at += 2
        last = wp.min(i + count, n)
        for j in range(i, last):
            y[j] = wp.uint16(run >> ROW_COUNT_BITS)
        i = last
    return at


@wp.func
def read_packed_columns(data: Bytes, at: int, n: int, x: U16, p: Bytes):
    """Reads column and polarity of four events, of 12 bits each, in three half words."""
    i = wp.int32(0)
    while i < n:
        if at + COLUMN_GROUP_BYTES > data.shape[0]:
            return -1
        a = half(data, at)
        b = half(data, at + 2)
        c = half(data, at + 4)
        at += COLUMN_GROUP_BYTES
        for k in range(GROUP):
            v = a >> 4
            if k == 1:
                v = (a & 15) | ((b >> 8) << 4)
            elif k == 2:
                v = (b & 0xFF) | ((c >> 12) << 8)
            elif k == 3:
                v = c & 0xFFF
            x[i + k] = wp.uint16(v >> X_SHIFT)
            p[i + k] = wp.uint8(v & 1)
        i += GROUP
    return at


@wp.func
def read_masked_columns(data: Bytes, at: int, n: int, x: U16):
    """Reads a column, and a mask of the five behind it."""
    i = wp.int32(0)
    while i < n:
        if at + 2 > data.shape[0]:
            return -1
        masked = half(data, at)
        at += 2
        x[i] = wp.uint16(masked >> MASK_BITS)
        i += 1
        for k in range(MASK_BITS):
            if ((masked >> (MASK_BITS - 1 - k)) & 1) == 1:
                x[i] = wp.uint16((masked >> MASK_BITS) + k + 1)
                i += 1
    return at


@wp.func
def read_polarities(data: Bytes, at: int, n: int, p: Bytes):
    """Reads runs of events of one polarity."""
    i = wp.int32(0)
    while i < n:
        if at >= data.shape[0]:
            return -1
        run = int(data[at])
        at += 1
        count = run & POLARITY_COUNT_MAX
        if count == POLARITY_COUNT_MAX:
            if at + 2 > data.shape[0]:
                return -1
            count = half(data, at)
            at += 2
        last = wp.min(i + count, n)
        for j in range(i, last):
            p[j] = wp.uint8(run >> POLARITY_COUNT_BITS)
        i = last
    return at


@wp.kernel(module="unique", enable_backward=False)
def decode_ecf(
    # in
    data: Bytes,
    n: int,
    t0: wp.int64,
    yxp: int,
    xp: int,
    # out
    out: wp.array(dtype=wp.int64),
    t: wp.array(dtype=wp.int64),
    x: U16,
    y: U16,
    p: Bytes,
):
    """Decodes one chunk of ECF to events.

    Args:
        data: the chunk, its head included.
        n: events in the chunk.
        t0: time of the first event [us].
        yxp: 1 where row, column and polarity are packed together.
        xp: 1 where column and polarity are packed together, behind the rows.
        out: gets 1 where the data end early, else 0.
        t: times [us], with five places more than events, as the other columns.
        x: pixel columns.
        y: pixel rows.
        p: polarities, 1 = ON.
    """
    at = read_times(data, HEAD_BYTES, n, t0, t)
    if at >= 0 and yxp == 1:
        at = read_packed_events(data, at, n, x, y, p)
    elif at >= 0:
        at = read_rows(data, at, n, y)
        if at >= 0 and xp == 1:
            at = read_packed_columns(data, at, n, x, p)
        elif at >= 0:
            at = read_masked_columns(data, at, n, x)
            if at >= 0:
                at = read_polarities(data, at, n, p)
    out[0] = wp.int64(wp.where(at < 0, 1, 0))
