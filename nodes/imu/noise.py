"""Draws counter-based normal numbers for inertial noise: the n-th sample has its own, however the stream is cut."""

from __future__ import annotations

import numpy as np

from evis.random_numbers import GOLDEN, mix, open_uniform, standard_normal

STREAM = 0x696D75
"""Keeps these random numbers apart from others of the same seed."""


def normals(seed: int, episode: int, samples: np.ndarray, columns: int) -> np.ndarray:
    """Draws independent standard normal numbers [n, columns] for the sample counters int64 [n] (Box and Muller)."""
    key = np.array([seed & (2**64 - 1)], np.uint64)
    for value in (STREAM, episode & (2**64 - 1)):
        key = mix((key ^ np.uint64(value)) + GOLDEN)
    rows = mix((key ^ samples.astype(np.uint64)) + GOLDEN)[:, None]
    draws = mix((rows ^ mix(np.arange(2 * columns, dtype=np.uint64) + GOLDEN)) + GOLDEN)
    return standard_normal(open_uniform(draws[:, :columns]), open_uniform(draws[:, columns:]))
