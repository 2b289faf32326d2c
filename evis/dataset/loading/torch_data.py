"""Offers windows to PyTorch: a map-style and an iterable data set.

Only this and the twin of the stream import torch.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch.utils.data import Dataset, IterableDataset, get_worker_info

from evis.dataset.loading.cut import check_whole
from evis.dataset.loading.order import given_place, share

if TYPE_CHECKING:
    from evis.dataset.loading.windows import Windows


class Epoch:
    """Holds the number of the epoch in memory that workers share, also those that live on from epoch to epoch."""

    def __init__(self, number: int = 0) -> None:
        self._number = torch.tensor(number, dtype=torch.int64).share_memory_()

    def set(self, epoch: int) -> None:
        """Sets the number of the epoch for all processes. Raises DatasetError."""
        check_whole("epoch", epoch)
        self._number.fill_(epoch)

    @property
    def number(self) -> int:
        """Returns the epoch."""
        return int(self._number)


class WindowDataset(Dataset[dict[str, Any]]):
    """Gives windows by number, in tensors; a pure function of seed, epoch and number."""

    def __init__(self, windows: Windows) -> None:
        self.windows, self._epoch = windows, Epoch(windows.epoch)

    def set_epoch(self, epoch: int) -> None:
        """Says which epoch it is, on which the augmentation depends."""
        self._epoch.set(epoch)

    def __len__(self) -> int:
        return len(self.windows)

    def __getitem__(self, i: int) -> dict[str, Any]:
        return tensors(self.windows.sample(i, self._epoch.number))


class WindowIterable(IterableDataset[dict[str, Any]]):
    """Gives windows one after the other, in tensors; workers and ranks share them without doubles."""

    def __init__(self, windows: Windows, shuffle: bool, rank: int | None, ranks: int | None) -> None:
        """rank, ranks: None = those of torch.distributed."""
        self.windows, self._shuffle, self._epoch = windows, shuffle, Epoch(windows.epoch)
        self._rank, self._ranks = place_among(rank, ranks)

    def set_epoch(self, epoch: int) -> None:
        """Says which epoch it is, on which order and augmentation depend."""
        self._epoch.set(epoch)

    def __len__(self) -> int:
        """Counts those of this rank."""
        return len(self.windows) // self._ranks

    def __iter__(self) -> Iterator[dict[str, Any]]:
        epoch = self._epoch.number
        own = self.windows.order(self._shuffle, epoch, self._rank, self._ranks)
        for i in share(own, 0, 1, *worker()):
            yield tensors(self.windows.sample(int(i), epoch))


def place_among(rank: int | None, ranks: int | None) -> tuple[int, int]:
    """Returns rank and number of ranks: those given, those of torch.distributed, or 0 of 1. Raises DatasetError."""
    if (given := given_place(rank, ranks)) is not None:
        return given
    distributed = torch.distributed
    if not (distributed.is_available() and distributed.is_initialized()):
        return 0, 1
    return distributed.get_rank(), distributed.get_world_size()


def worker() -> tuple[int, int]:
    """Returns the number of this DataLoader's worker and how many there are; 0 of 1 outside one."""
    info = get_worker_info()
    return (0, 1) if info is None else (info.id, info.num_workers)


def tensors(sample: dict[str, Any]) -> dict[str, Any]:
    """Returns a sample whose arrays are tensors, in the same memory."""
    found = {}
    for name, value in sample.items():
        if isinstance(value, dict):
            value = tensors(value)
        elif isinstance(value, np.ndarray | np.generic):
            value = torch.as_tensor(value if value.flags.writeable else value.copy())
        found[name] = value
    return found
