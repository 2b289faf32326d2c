"""Decodes and encodes chunks of ECF, whose layout `ecf_layout` describes."""

from __future__ import annotations

import struct

import numpy as np

from evis.events.files.hdf5.ecf_layout import (
    COLUMN_GROUP_BYTES,
    COUNT_SHIFT,
    EVENT_GROUP_BYTES,
    GROUP,
    HEAD,
    HEAD_BYTES,
    LAST_SHIFT,
    MASK_BITS,
    MAX_EVENTS,
    MAX_SIDE,
    PACKED_COLUMNS,
    PACKED_EVENTS,
    POLARITY_COUNT_BITS,
    ROW_COUNT_BITS,
    SIDE_MASK,
    STEP_BITS,
    STEP_MAX,
    X_SHIFT,
    Y_SHIFT,
    Head,
    read_head,
)
from evis.events.files.reading.decompress import DamagedError

_ENDS_EARLY = (struct.error, IndexError, ValueError)
"""Errors of reading behind the end of a chunk."""

Columns = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def decode(data: bytes, backend: str = "numpy") -> Columns:
    """Decodes one chunk to (t int64 [us], x uint16, y uint16, p uint8). Raises DamagedError."""
    head = _head(data)
    if head.n > MAX_EVENTS:
        raise DamagedError(f"an ECF chunk claims {head.n} events, the limit is {MAX_EVENTS}")
    return _launch(data, head) if backend == "warp" else _loop(data, head)[0]


def decode_some(data: bytes) -> tuple[Columns, int]:
    """Decodes the chunk at the start of `data`, and tells how many bytes it takes. Raises DamagedError."""
    return _loop(data, _head(data))


def _head(data: bytes) -> Head:
    head = read_head(data)
    if head is None:
        raise DamagedError("an ECF chunk is cut inside its header")
    return head


def _loop(data: bytes, head: Head) -> tuple[Columns, int]:
    n, groups = head.n, -(-head.n // GROUP)
    try:
        t, at = _times(data, n, head.t0)
        if head.yxp:
            x, y, p = _packed_yxp(data, at, n)
            at += EVENT_GROUP_BYTES * groups
        else:
            y, at = _runs(data, at, n, 2, ROW_COUNT_BITS)
            if head.xp:
                x, p = _packed_xp(data, at, n)
                at += COLUMN_GROUP_BYTES * groups
            else:
                x, p, at = _masked(data, at, n)
    except _ENDS_EARLY as error:
        raise DamagedError(f"an ECF chunk is damaged ({type(error).__name__})") from None
    return (t, x, y.astype(np.uint16), p), at


def decode_cut(data: bytes) -> Columns:
    """Decodes the first events of a chunk whose end is missing: those with all of their parts in it.

    Times and rows come first, so that there are none unless the cut lies behind these; none either where polarities are
    stored apart, behind everything else.
    """
    none = (np.empty(0, np.int64), np.empty(0, np.uint16), np.empty(0, np.uint16), np.empty(0, np.uint8))
    head = read_head(data)
    if head is None or head.n > MAX_EVENTS or not (head.yxp or head.xp):
        return none
    n, t0, yxp, _ = head
    # of four events the first is whole after a third of their bytes, the second after two, the others at the end
    size = EVENT_GROUP_BYTES if yxp else COLUMN_GROUP_BYTES
    try:
        t, at = _times(data, n, t0)
        y = np.empty(0, np.int64)
        if not yxp:
            y, at = _runs(data, at, n, 2, ROW_COUNT_BITS)
        n = min(n, (len(data) - at) // size * GROUP + (len(data) - at) % size // (size // 3))
        data += bytes(size)
        if yxp:
            x, y, p = _packed_yxp(data, at, n)
        else:
            x, p = _packed_xp(data, at, n)
    except _ENDS_EARLY:
        return none
    return t[:n], x, y[:n].astype(np.uint16), p


def _times(data: bytes, n: int, t0: int) -> tuple[np.ndarray, int]:
    at, t, i = HEAD_BYTES, t0, 0
    runs: list[tuple[int, int]] = []
    while i < n:
        step, count = data[at] >> STEP_BITS, data[at] & STEP_MAX
        at += 1
        if step == STEP_MAX:
            shift = 0
            step = count
            while data[at] >> STEP_BITS == STEP_MAX:
                shift += STEP_BITS
                if shift > LAST_SHIFT:
                    raise DamagedError("an ECF chunk has an endless time step")
                step |= (data[at] & STEP_MAX) << shift
                at += 1
            t += step
            continue
        if count == STEP_MAX:
            count = struct.unpack_from("<H", data, at)[0]
            at += 2
        t += step
        runs.append((t, count))
        i += count
    values, counts = np.array(runs, np.int64).reshape(-1, 2).T
    return np.repeat(values, counts)[:n], at


def _runs(data: bytes, at: int, n: int, size: int, bits: int) -> tuple[np.ndarray, int]:
    """Decodes run lengths in words of `size` bytes: value << bits | count, all ones: the count follows as u16."""
    code, most, i = {1: "<B", 2: "<H"}[size], (1 << bits) - 1, 0
    runs: list[tuple[int, int]] = []
    while i < n:
        word = struct.unpack_from(code, data, at)[0]
        at += size
        value, count = word >> bits, word & most
        if count == most:
            count = struct.unpack_from("<H", data, at)[0]
            at += 2
        runs.append((value, count))
        i += count
    values, counts = np.array(runs, np.int64).reshape(-1, 2).T
    return np.repeat(values, counts)[:n], at


def _packed_yxp(data: bytes, at: int, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    groups = -(-n // GROUP)
    w = np.frombuffer(data, "<u4", 3 * groups, at).reshape(groups, 3)
    v = np.stack(
        [w[:, 0] >> 8, w[:, 0] & 0xFF | w[:, 1] >> 16 << 8, w[:, 1] & 0xFFFF | w[:, 2] >> 24 << 16, w[:, 2] & 0xFFFFFF],
        1,
    ).reshape(-1)[:n]
    return (v >> X_SHIFT & SIDE_MASK).astype(np.uint16), v >> Y_SHIFT & SIDE_MASK, (v & 1).astype(np.uint8)


def _packed_xp(data: bytes, at: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    groups = -(-n // GROUP)
    w = np.frombuffer(data, "<u2", 3 * groups, at).reshape(groups, 3)
    v = np.stack(
        [w[:, 0] >> 4, w[:, 0] & 15 | w[:, 1] >> 8 << 4, w[:, 1] & 0xFF | w[:, 2] >> 12 << 8, w[:, 2] & 0xFFF], 1
    ).reshape(-1)[:n]
    return (v >> X_SHIFT).astype(np.uint16), (v & 1).astype(np.uint8)


def _masked(data: bytes, at: int, n: int) -> tuple[np.ndarray, np.ndarray, int]:
    words = np.frombuffer(data, "<u2", (len(data) - at) // 2, at)[:n]
    bits = np.concatenate(
        [np.ones((len(words), 1), bool), (words[:, None] >> np.arange(MASK_BITS - 1, -1, -1) & 1).astype(bool)], 1
    )
    total = np.cumsum(bits.sum(1))
    used = int(np.searchsorted(total, n)) + 1 if n else 0
    if used > len(words):
        raise IndexError("too few columns")
    x = ((words[:used] >> MASK_BITS)[:, None] + np.arange(1 + MASK_BITS, dtype=np.uint16))[bits[:used]][:n]
    signs, at = _runs(data, at + 2 * used, n, 1, POLARITY_COUNT_BITS)
    return x, signs.astype(np.uint8), at


def _launch(data: bytes, head: Head) -> Columns:
    from evis.events.codecs.warp_calls import run
    from evis.events.files.hdf5.ecf_kernels import decode_ecf

    n = head.n
    # packed events come in fours, masked columns in up to six
    t, x, y, p = (np.zeros(n + MASK_BITS, d) for d in (np.int64, np.uint16, np.uint16, np.uint8))
    out = np.zeros(1, np.int64)
    run(
        decode_ecf,
        [np.frombuffer(data, np.uint8), n, np.int64(head.t0), int(head.yxp), int(head.xp)],
        [out, t, x, y, p],
    )
    if out[0]:
        raise DamagedError("an ECF chunk is damaged (it ends early)")
    return t[:n], x[:n], y[:n], p[:n]


def encode(t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray) -> bytes:
    """Encodes one chunk of events, t int64 [us], going up; x and y below 2048. Raises ValueError."""
    n = len(t)
    if n > MAX_EVENTS or (n and (int(max(x.max(), y.max())) >= MAX_SIDE or (np.diff(t) < 0).any())):
        raise ValueError(
            f"ECF holds up to {MAX_EVENTS} events of one order in time and coordinates up to {MAX_SIDE - 1}"
        )
    new_row = np.count_nonzero(np.diff(y.astype(np.int64)) != 0)
    yxp = bool(n) and new_row > 0.8 * n
    head = HEAD.pack(n << COUNT_SHIFT | (PACKED_EVENTS if yxp else PACKED_COLUMNS), int(t[0]) if n else 0)
    if yxp:
        v = np.zeros(-(-n // GROUP) * GROUP, np.uint32)
        v[:n] = y.astype(np.uint32) << Y_SHIFT | x.astype(np.uint32) << X_SHIFT | p
        a, b, c, d = v.reshape(-1, GROUP).T
        rest = np.stack([a << 8 | b & 0xFF, b >> 8 << 16 | c & 0xFFFF, c >> 16 << 24 | d], 1).astype("<u4").tobytes()
    else:
        rest = _encode_rows(y) + _encode_columns(x, p)
    return head + _encode_times(t) + rest


def _encode_columns(x: np.ndarray, p: np.ndarray) -> bytes:
    words = np.zeros(-(-len(x) // GROUP) * GROUP, np.uint16)
    words[: len(x)] = x << X_SHIFT | p
    a, b, c, d = words.reshape(-1, GROUP).T
    return np.stack([a << 4 | b & 15, b >> 4 << 8 | c & 0xFF, c >> 8 << 12 | d], 1).astype("<u2").tobytes()


def _encode_times(t: np.ndarray) -> bytes:
    out = bytearray()
    starts = np.flatnonzero(np.diff(t, prepend=t[:1] - 1))
    counts = np.diff(np.append(starts, len(t)))
    for step, count in zip(np.diff(t[starts], prepend=t[:1]).tolist(), counts.tolist()):
        if step >= STEP_MAX:
            while step:
                out.append(STEP_MAX << STEP_BITS | step & STEP_MAX)
                step >>= STEP_BITS
        if count >= STEP_MAX:
            out += bytes((step << STEP_BITS | STEP_MAX, count & 0xFF, count >> 8))
        else:
            out.append(step << STEP_BITS | count)
    return bytes(out)


def _encode_rows(y: np.ndarray) -> bytes:
    starts = np.flatnonzero(np.diff(y.astype(np.int64), prepend=-1))
    counts = np.diff(np.append(starts, len(y)))
    most = (1 << ROW_COUNT_BITS) - 1
    long = counts >= most
    words = np.empty((len(starts), 2), np.uint16)
    words[:, 0] = y[starts] << ROW_COUNT_BITS | np.minimum(counts, most).astype(np.uint16)
    words[:, 1] = counts
    keep = np.stack([np.ones(len(starts), bool), long], 1)
    return words[keep].astype("<u2").tobytes()
