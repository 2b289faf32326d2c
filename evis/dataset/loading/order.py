"""Computes in which order windows come, and who takes which: a hash of seed and epoch, the same in every process."""

from __future__ import annotations

import numpy as np

from evis.dataset.draws import bits_at, key_of
from evis.dataset.errors import DatasetError
from evis.dataset.loading.cut import check_whole


def check_place(rank: int, ranks: int) -> None:
    """Raises DatasetError for a rank that is none of `ranks`: it would take the windows of others."""
    check_whole("ranks", ranks, 1)
    check_whole("rank", rank, 0)
    if rank >= ranks:
        raise DatasetError(f"rank is {rank} of {ranks} ranks; they are numbered from 0")


def given_place(rank: int | None, ranks: int | None) -> tuple[int, int] | None:
    """Returns rank and number of ranks; None where neither is given. Raises DatasetError."""
    if rank is None and ranks is None:
        return None
    if rank is None or ranks is None:
        raise DatasetError("rank and ranks are given together, or neither of them")
    check_place(rank, ranks)
    return rank, ranks


def order(count: int, shuffle: bool, seed: int, epoch: int) -> np.ndarray:
    """Returns a permutation of `count` things, int64; as they are without `shuffle`."""
    if not shuffle:
        return np.arange(count)
    bits = bits_at(key_of(seed, "order", epoch), np.arange(count, dtype=np.uint64))
    return np.argsort(bits, kind="stable")


def share(indices: np.ndarray, rank: int, ranks: int, worker: int = 0, workers: int = 1) -> np.ndarray:
    """Returns the part of the windows that a worker of a rank takes.

    Each rank has equally many, so that none waits for another at the end of an epoch: up to ranks - 1 are left out.
    """
    own = indices[: len(indices) // ranks * ranks][rank::ranks]
    return own[worker::workers]
