"""Prophesee's ECF compression of HDF5 chunks (filter 0x8ECF), at most 65535 events a chunk.

u32 = events << 2 | yxp packed << 1 | xp packed; u64 first time [us]. Then the times as bytes (step << 4 | count): a
count of 15 is followed by the count as u16, a step of 15 adds the low nibble to the next step, least nibble first. Then
either three words of 4 events each (y << 12 | x << 1 | p, 24 bits), or runs of rows as u16 (y << 5 | count, 31: a u16
follows) and columns: 12-bit (x << 1 | p), 4 in three u16, or u16 (x << 5 | mask of the 5 pixels behind it, first pixel
in the highest bit) with runs of polarity as bytes (p << 7 | count, 127: a u16 follows). In packed words an event that
does not fit has its low bits at the end of one word and its high bits at the start of the next.
"""

from __future__ import annotations

import struct

import numpy as np

from evis.events.files.reading.decompress import DamagedError

FILTER = 0x8ECF
MAX_EVENTS = 65535
_HEAD = struct.Struct("<Iq")

Columns = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def decode(data: bytes, backend: str = "numpy") -> Columns:
    """(t int64 [us], x uint16, y uint16, p uint8) of one chunk. Raises DamagedError."""
    if len(data) < _HEAD.size:
        raise DamagedError("an ECF chunk is cut inside its header")
    word, t0 = _HEAD.unpack_from(data)
    n = word >> 2
    if n > MAX_EVENTS:
        raise DamagedError(f"an ECF chunk claims {n} events, the limit is {MAX_EVENTS}")
    if backend == "warp":
        return _launch(data, n, t0, bool(word & 2), bool(word & 1))
    return _loop(data, n, t0, bool(word & 2), bool(word & 1))[0]


def decode_some(data: bytes) -> tuple[Columns, int]:
    """One chunk at the start of `data`, and how many bytes it takes. Raises DamagedError."""
    if len(data) < _HEAD.size:
        raise DamagedError("an ECF chunk is cut inside its header")
    word, t0 = _HEAD.unpack_from(data)
    return _loop(data, word >> 2, t0, bool(word & 2), bool(word & 1))


def _loop(data: bytes, n: int, t0: int, yxp: bool, xp: bool) -> tuple[Columns, int]:
    groups = -(-n // 4)
    try:
        t, at = _times(data, n, t0)
        if yxp:
            x, y, p = _packed_yxp(data, at, n)
            at += 12 * groups
        else:
            y, at = _runs(data, at, n, 2, 5)
            if xp:
                x, p = _packed_xp(data, at, n)
                at += 6 * groups
            else:
                x, p, at = _masked(data, at, n)
    except (struct.error, IndexError, ValueError) as error:
        raise DamagedError(f"an ECF chunk is damaged ({type(error).__name__})") from None
    return (t, x, y.astype(np.uint16), p), at


def decode_cut(data: bytes) -> Columns:
    """The first events of a chunk of which only the beginning is there: those with all of their parts in it.

    Times and rows come first, so that there are none unless the cut lies behind these; none either where polarities are
    stored apart, behind everything else.
    """
    none = (np.empty(0, np.int64), np.empty(0, np.uint16), np.empty(0, np.uint16), np.empty(0, np.uint8))
    if len(data) < _HEAD.size:
        return none
    word, t0 = _HEAD.unpack_from(data)
    n, yxp, xp = word >> 2, bool(word & 2), bool(word & 1)
    if n > MAX_EVENTS or not (yxp or xp):
        return none
    # of four events the first is whole after a third of their bytes, the second after two, the others at the end
    size = 12 if yxp else 6
    try:
        t, at = _times(data, n, t0)
        y = np.empty(0, np.int64)
        if not yxp:
            y, at = _runs(data, at, n, 2, 5)
        n = min(n, (len(data) - at) // size * 4 + (len(data) - at) % size // (size // 3))
        data += bytes(size)
        if yxp:
            x, y, p = _packed_yxp(data, at, n)
        else:
            x, p = _packed_xp(data, at, n)
    except (struct.error, IndexError, ValueError):
        return none
    return t[:n], x, y[:n].astype(np.uint16), p


def _times(data: bytes, n: int, t0: int) -> tuple[np.ndarray, int]:
    at, t, i = _HEAD.size, t0, 0
    runs: list[tuple[int, int]] = []
    while i < n:
        step, count = data[at] >> 4, data[at] & 15
        at += 1
        if step == 15:
            shift = 0
            step = count
            while data[at] >> 4 == 15:
                shift += 4
                if shift > 56:
                    raise DamagedError("an ECF chunk has an endless time step")
                step |= (data[at] & 15) << shift
                at += 1
            t += step
            continue
        if count == 15:
            count = struct.unpack_from("<H", data, at)[0]
            at += 2
        t += step
        runs.append((t, count))
        i += count
    values, counts = np.array(runs, np.int64).reshape(-1, 2).T
    return np.repeat(values, counts)[:n], at


def _runs(data: bytes, at: int, n: int, size: int, bits: int) -> tuple[np.ndarray, int]:
    """Run lengths in words of `size` bytes: value << bits | count, all ones: the count follows as u16."""
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
    groups = -(-n // 4)
    w = np.frombuffer(data, "<u4", 3 * groups, at).reshape(groups, 3)
    v = np.stack(
        [w[:, 0] >> 8, w[:, 0] & 0xFF | w[:, 1] >> 16 << 8, w[:, 1] & 0xFFFF | w[:, 2] >> 24 << 16, w[:, 2] & 0xFFFFFF],
        1,
    ).reshape(-1)[:n]
    return (v >> 1 & 0x7FF).astype(np.uint16), v >> 12 & 0x7FF, (v & 1).astype(np.uint8)


def _packed_xp(data: bytes, at: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    groups = -(-n // 4)
    w = np.frombuffer(data, "<u2", 3 * groups, at).reshape(groups, 3)
    v = np.stack(
        [w[:, 0] >> 4, w[:, 0] & 15 | w[:, 1] >> 8 << 4, w[:, 1] & 0xFF | w[:, 2] >> 12 << 8, w[:, 2] & 0xFFF], 1
    ).reshape(-1)[:n]
    return (v >> 1).astype(np.uint16), (v & 1).astype(np.uint8)


def _masked(data: bytes, at: int, n: int) -> tuple[np.ndarray, np.ndarray, int]:
    words = np.frombuffer(data, "<u2", (len(data) - at) // 2, at)[:n]
    bits = np.concatenate(
        [np.ones((len(words), 1), bool), (words[:, None] >> np.arange(4, -1, -1) & 1).astype(bool)], 1
    )
    total = np.cumsum(bits.sum(1))
    used = int(np.searchsorted(total, n)) + 1 if n else 0
    if used > len(words):
        raise IndexError("too few columns")
    x = ((words[:used] >> 5)[:, None] + np.arange(6, dtype=np.uint16))[bits[:used]][:n]
    signs, at = _runs(data, at + 2 * used, n, 1, 7)
    return x, signs.astype(np.uint8), at


def _launch(data: bytes, n: int, t0: int, yxp: bool, xp: bool) -> Columns:
    from evis.events.codecs.warp_calls import run
    from evis.events.files.hdf5.ecf_kernels import decode_ecf

    # five more than n: packed events come in fours, masked columns in up to six
    t, x, y, p = (np.zeros(n + 5, d) for d in (np.int64, np.uint16, np.uint16, np.uint8))
    out = np.zeros(1, np.int64)
    run(decode_ecf, [np.frombuffer(data, np.uint8), n, np.int64(t0), int(yxp), int(xp)], [out, t, x, y, p])
    if out[0]:
        raise DamagedError("an ECF chunk is damaged (it ends early)")
    return t[:n], x[:n], y[:n], p[:n]


def encode(t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray) -> bytes:
    """One chunk of events, t int64 [us], going up; x and y below 2048. Raises ValueError."""
    n = len(t)
    if n > MAX_EVENTS or (n and (int(max(x.max(), y.max())) >= 2048 or (np.diff(t) < 0).any())):
        raise ValueError("ECF holds up to 65535 events of one order in time and coordinates up to 2047")
    new_row = np.count_nonzero(np.diff(y.astype(np.int64)) != 0)
    yxp = bool(n) and new_row > 0.8 * n
    head = _HEAD.pack(n << 2 | (2 if yxp else 1), int(t[0]) if n else 0)
    if yxp:
        v = np.zeros(-(-n // 4) * 4, np.uint32)
        v[:n] = y.astype(np.uint32) << 12 | x.astype(np.uint32) << 1 | p
        a, b, c, d = v.reshape(-1, 4).T
        rest = np.stack([a << 8 | b & 0xFF, b >> 8 << 16 | c & 0xFFFF, c >> 16 << 24 | d], 1).astype("<u4").tobytes()
    else:
        rest = _encode_rows(y) + _encode_columns(x, p)
    return head + _encode_times(t) + rest


def _encode_columns(x: np.ndarray, p: np.ndarray) -> bytes:
    words = np.zeros(-(-len(x) // 4) * 4, np.uint16)
    words[: len(x)] = x << 1 | p
    a, b, c, d = words.reshape(-1, 4).T
    return np.stack([a << 4 | b & 15, b >> 4 << 8 | c & 0xFF, c >> 8 << 12 | d], 1).astype("<u2").tobytes()


def _encode_times(t: np.ndarray) -> bytes:
    out = bytearray()
    starts = np.flatnonzero(np.diff(t, prepend=t[:1] - 1))
    counts = np.diff(np.append(starts, len(t)))
    for step, count in zip(np.diff(t[starts], prepend=t[:1]).tolist(), counts.tolist()):
        if step >= 15:
            while step:
                out.append(0xF0 | step & 15)
                step >>= 4
        if count >= 15:
            out += bytes((step << 4 | 15, count & 0xFF, count >> 8))
        else:
            out.append(step << 4 | count)
    return bytes(out)


def _encode_rows(y: np.ndarray) -> bytes:
    starts = np.flatnonzero(np.diff(y.astype(np.int64), prepend=-1))
    counts = np.diff(np.append(starts, len(y)))
    long = counts >= 31
    words = np.empty((len(starts), 2), np.uint16)
    words[:, 0] = y[starts] << 5 | np.minimum(counts, 31).astype(np.uint16)
    words[:, 1] = counts
    keep = np.stack([np.ones(len(starts), bool), long], 1)
    return words[keep].astype("<u2").tobytes()
