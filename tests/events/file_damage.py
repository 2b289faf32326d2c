"""Damages files at random, and reads whatever comes of it."""

from __future__ import annotations

import numpy as np

from evis.events import RecordingError, open_recording

HOSTILE = [b"\xff" * 4, b"\xff" * 8, b"\x00" * 4, b"\xff\xff\xff\x7f", b"\x00\x00\x00\x80", b"\n", b"\x01\x00\x00\x00"]


def check(path) -> int:
    """Read all, or fail with one line. The number of events."""
    try:
        with open_recording(path) as recording:
            events, info = recording.read(), recording.info
            assert recording.next_t_ns is None
            recording.seek(int(events.t[len(events) // 2]) if len(events) else 0)
            recording.read_until(2**61)
    except RecordingError as error:
        assert str(path) in str(error) and "\n" not in str(error), error
        return 0
    dtypes = [np.int64, np.uint16, np.uint16, np.uint8]
    assert [getattr(events, n).dtype for n in "txyp"] == dtypes
    assert len({len(getattr(events, n)) for n in "txyp"}) == 1
    if len(events):
        assert int(events.x.max()) < info.width and int(events.y.max()) < info.height and int(events.p.max()) <= 1
    assert len(events) < 1_000_000
    return len(events)


def damage(data: bytes, rng: np.random.Generator) -> bytes:
    """One to four edits: bytes, hostile numbers, cuts, repeats, swaps."""
    out = bytearray(data)
    for _ in range(rng.integers(1, 5)):
        at = int(rng.integers(0, max(len(out), 1)))
        kind = rng.integers(0, 6)
        if kind <= 1 and out:
            out[at % len(out)] = rng.integers(0, 256)
        elif kind == 2:
            word = HOSTILE[rng.integers(0, len(HOSTILE))]
            out[at : at + len(word)] = word
        elif kind == 3:
            del out[at : at + int(rng.integers(1, 60))]
        elif kind == 4:
            out[at:at] = out[at : at + int(rng.integers(1, 200))]
        elif rng.random() < 0.3:
            del out[at:]
    return bytes(out) or b"\0"
