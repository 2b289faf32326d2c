"""Computes in which order windows come, and who takes which: a hash of seed and epoch, the same in every process."""

from __future__ import annotations

import numpy as np

from evis.dataset.draws import key_of
from evis.random_numbers import GOLDEN, mix


def order(count: int, shuffle: bool, seed: int, epoch: int) -> np.ndarray:
    """Returns a permutation of `count` things, int64; as they are without `shuffle`."""
    if not shuffle:
        return np.arange(count)
    key = key_of(seed, "order", epoch)
    with np.errstate(over="ignore"):
        bits = mix(key + (np.arange(count, dtype=np.uint64) + np.uint64(1)) * GOLDEN)
    return np.argsort(bits, kind="stable")


def share(indices: np.ndarray, rank: int, ranks: int, worker: int = 0, workers: int = 1) -> np.ndarray:
    """Returns the part of the windows that a worker of a rank takes.

    Each rank has equally many, so that none waits for another at the end of an epoch: up to ranks - 1 are left out.
    """
    own = indices[: len(indices) // ranks * ranks][rank::ranks]
    return own[worker::workers]
