"""Counter-based normal numbers for inertial noise: the n-th sample has its own, however the stream is cut."""

from __future__ import annotations

import numpy as np

STREAM = 0x696D75
"""Keeps these random numbers apart from others of the same seed."""
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)


def _mix(h: np.ndarray) -> np.ndarray:
    """SplitMix64's output function (Steele, Lea and Flood, OOPSLA 2014) on uint64 arrays; wraps."""
    h = h + _GOLDEN
    h = (h ^ (h >> np.uint64(30))) * _FIRST
    h = (h ^ (h >> np.uint64(27))) * _SECOND
    return h ^ (h >> np.uint64(31))


def _uniform(h: np.ndarray) -> np.ndarray:
    """In (0, 1), from the upper 53 bits."""
    return ((h >> np.uint64(11)).astype(np.float64) + 0.5) * 2.0**-53


def normals(seed: int, episode: int, samples: np.ndarray, columns: int) -> np.ndarray:
    """Independent standard normal numbers [n, columns] of the sample counters int64 [n] (Box-Muller)."""
    key = np.array([seed & (2**64 - 1)], np.uint64)
    for value in (STREAM, episode & (2**64 - 1)):
        key = _mix(key ^ np.uint64(value))
    rows = _mix(key ^ samples.astype(np.uint64))[:, None]
    draws = _mix(rows ^ _mix(np.arange(2 * columns, dtype=np.uint64)))
    radius = np.sqrt(-2.0 * np.log(_uniform(draws[:, :columns])))
    return radius * np.cos(2.0 * np.pi * _uniform(draws[:, columns:]))
