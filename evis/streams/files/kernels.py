"""Sequential file decoders as Warp CPU kernels (dim = 1); the plain loop beside each caller is the reference."""

import numpy as np
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
    """out = bytes used, events, exposures, time [us]."""
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


@wp.func
def half(data: wp.array(dtype=wp.uint8), at: int):
    """The little-endian u16 at a byte, 0 behind the end."""
    if at + 2 > data.shape[0]:
        return 0
    return int(data[at]) | (int(data[at + 1]) << 8)


@wp.kernel(module="unique", enable_backward=False)
def decode_ecf(
    # in
    data: wp.array(dtype=wp.uint8),
    n: int,
    t0: wp.int64,
    yxp: int,
    xp: int,
    # out
    out: wp.array(dtype=wp.int64),
    t: wp.array(dtype=wp.int64),
    x: wp.array(dtype=wp.uint16),
    y: wp.array(dtype=wp.uint16),
    p: wp.array(dtype=wp.uint8),
):
    """out = 1 where the data end early."""
    out[0] = wp.int64(1)
    end = data.shape[0]
    at = wp.int32(12)
    now = t0
    i = wp.int32(0)
    jump = wp.int64(0)
    shift = wp.int32(0)
    while i < n:
        if at >= end:
            return
        step = int(data[at]) >> 4
        count = int(data[at]) & 15
        at += 1
        if step == 15:
            if shift > 56:
                return
            jump = jump | (wp.int64(count) << wp.int64(shift))
            shift += 4
        else:
            if count == 15:
                if at + 2 > end:
                    return
                count = half(data, at)
                at += 2
            now += jump + wp.int64(step)
            jump = wp.int64(0)
            shift = wp.int32(0)
            last = wp.min(i + count, n)
            for j in range(i, last):
                t[j] = now
            i = last
    if yxp == 1:
        i = wp.int32(0)
        while i < n:
            if at + 12 > end:
                return
            a = half(data, at) | (half(data, at + 2) << 16)
            b = half(data, at + 4) | (half(data, at + 6) << 16)
            c = half(data, at + 8) | (half(data, at + 10) << 16)
            at += 12
            for k in range(4):
                v = (a >> 8) & 0xFFFFFF
                if k == 1:
                    v = (a & 0xFF) | (((b >> 16) & 0xFFFF) << 8)
                elif k == 2:
                    v = (b & 0xFFFF) | (((c >> 24) & 0xFF) << 16)
                elif k == 3:
                    v = c & 0xFFFFFF
                y[i + k] = wp.uint16((v >> 12) & 0x7FF)
                x[i + k] = wp.uint16((v >> 1) & 0x7FF)
                p[i + k] = wp.uint8(v & 1)
            i += 4
    else:
        i = wp.int32(0)
        while i < n:
            if at + 2 > end:
                return
            word = half(data, at)
            at += 2
            count = word & 31
            if count == 31:
                if at + 2 > end:
                    return
                count = half(data, at)
                at += 2
            last = wp.min(i + count, n)
            for j in range(i, last):
                y[j] = wp.uint16(word >> 5)
            i = last
        i = wp.int32(0)
        if xp == 1:
            while i < n:
                if at + 6 > end:
                    return
                a = half(data, at)
                b = half(data, at + 2)
                c = half(data, at + 4)
                at += 6
                for k in range(4):
                    v = a >> 4
                    if k == 1:
                        v = (a & 15) | ((b >> 8) << 4)
                    elif k == 2:
                        v = (b & 0xFF) | ((c >> 12) << 8)
                    elif k == 3:
                        v = c & 0xFFF
                    x[i + k] = wp.uint16(v >> 1)
                    p[i + k] = wp.uint8(v & 1)
                i += 4
        else:
            while i < n:
                if at + 2 > end:
                    return
                word = half(data, at)
                at += 2
                x[i] = wp.uint16(word >> 5)
                i += 1
                for k in range(5):
                    if ((word >> (4 - k)) & 1) == 1:
                        # the buffers have five places more than n
                        x[i] = wp.uint16((word >> 5) + k + 1)
                        i += 1
            i = wp.int32(0)
            while i < n:
                if at >= end:
                    return
                word = int(data[at])
                at += 1
                count = word & 127
                if count == 127:
                    if at + 2 > end:
                        return
                    count = half(data, at)
                    at += 2
                last = wp.min(i + count, n)
                for j in range(i, last):
                    p[j] = wp.uint8(word >> 7)
                i = last
    out[0] = wp.int64(0)


def run(kernel: wp.Kernel, inputs: list, outputs: list[np.ndarray]) -> None:
    """One thread over whole buffers; numpy arrays are read and written in place."""

    def view(value):
        if not isinstance(value, np.ndarray):
            return value
        return wp.array(value, dtype=wp.dtype_from_numpy(value.dtype), device="cpu", copy=False)

    wp.launch(kernel, dim=1, inputs=[view(v) for v in inputs], outputs=[view(v) for v in outputs], device="cpu")
