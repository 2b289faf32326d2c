"""Words of every codec that are likely to mean something, for the tests that decode what nobody has encoded."""

from __future__ import annotations

import numpy as np
from codec_cases import decoder


def likely_words(encoding: str, seed: int, n: int) -> bytes:
    """Words of the kinds that matter, with addresses now and then outside, and time words of all sorts."""
    rng = np.random.default_rng(seed)
    any_word = rng.integers(0, 1 << 63, n, dtype=np.int64)
    dtype = decoder(encoding).word
    if encoding in ("davis346", "dvxplorer"):
        code = rng.choice([0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12], n)
        words = code << 12 | any_word & 0xFFF
        special = rng.random(n) < 0.15
        words[special] = rng.integers(0, 19, int(special.sum()))
        small = rng.random(n) < 0.8
        words[small] &= ~0xE80
        return words.astype(dtype).tobytes()
    if encoding == "dvxplorer_mini":
        kind = rng.choice([1 << 31, 1 << 31, 1 << 26, 1 << 26 | 1 << 21, 1 << 27, 0], n)
        words = kind | any_word & rng.choice([0x7C3FFFFF, 0xFF, 0x1FFCFF], n)
        rising = kind == 1 << 27
        words[rising] = (1 << 27) + np.cumsum(rising)[rising] % (1 << 22)
        columns = np.cumsum(rng.integers(0, 3, n)) % 640
        plain = (kind == 1 << 26) & (rng.random(n) < 0.9)
        words[plain] = kind[plain] | columns[plain]
        return words.astype(dtype).tobytes()
    if encoding == "dvs128":
        words = any_word & 0x3FFFFFFF
        words |= rng.choice([0, 0, 0, 0, 0, 1 << 31, 1 << 30], n)
        return words.astype(dtype).tobytes()
    if encoding == "libcaer_cmp":
        return (rng.choice(7, n) << 12 | any_word & 0xFFF).astype(dtype).tobytes()
    x, y, low = rng.integers(0, 700, n), rng.integers(0, 500, n), any_word & 0xFFFFFFFF
    if encoding in ("mono", "trigger"):
        words = rng.integers(0, 2, n) << 63 | (y if encoding == "mono" else y % 300) << 48 | x << 32 | low
    elif encoding == "libcaer":
        us = np.cumsum(rng.integers(-3, 1 << 22, n)) & 0x7FFFFFFF
        words = us << 32 | x << 17 | y << 2 | any_word & 2 | (rng.random(n) < 0.9)
    elif encoding == "evt3":
        words = rng.choice([0, 2, 3, 4, 5, 6, 8, 10, 11, 14], n) << 12 | any_word & rng.choice([0xFFF, 0xBFF, 0x9FF], n)
    elif encoding == "evt4":
        kinds = [6, 7, 9, 0xA, 0xB, 0xC, 0xD, 0xE, 0xE, 0xF, 3]
        words = rng.choice(kinds, n) << 28 | (any_word & 63) << 22 | x << 11 | y
        any_mask = rng.random(n) < 0.2
        words[any_mask] = low[any_mask]
    else:
        head = rng.choice([0, 1, 1, 8, 10, 13, 14], n) << 28 | (any_word & 63) << 22 | x << 11 | y
        words = head if encoding == "evt2" else head << 32 | low & any_word >> 20
    data = words.astype(np.uint64).astype(dtype)
    return (data >> np.uint64(32) | data << np.uint64(32) if encoding == "evt21_legacy" else data).tobytes()
