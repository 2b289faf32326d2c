"""Gives the windows of sequences by number: a map-style data set, in numpy alone."""

from __future__ import annotations

import operator
from collections.abc import Iterator
from importlib import import_module
from typing import Any

import numpy as np

from evis.dataset.errors import DatasetError
from evis.dataset.loading.collate import check_size, collate
from evis.dataset.loading.cut import Cut, check_whole
from evis.dataset.loading.order import check_place, order, share
from evis.dataset.loading.sample import Sample, contiguous, sample_of
from evis.dataset.loading.sequence import Sequence
from evis.dataset.loading.stored import Stored, Table, table_of

TORCH = "evis.dataset.loading.torch_data"


class Windows:
    """Holds windows of some sequences, which are read when they are asked for.

    `[i]` is a sample of numpy arrays (docs/loading.md), a pure function of seed, epoch and i; `len` counts them. It may
    be pickled, and read by several processes. `torch()` and `torch_iterable()` give the same to PyTorch.

    left_out: windows without a label that is asked for, and sequences shorter than a window; the rest is here.
    """

    def __init__(self, sequences: list[Sequence], cut: Cut, place: str) -> None:
        """Lists the windows. Raises DatasetError where there is none, or labels that are asked for are not there."""
        self.cut, self._place, self.epoch = cut, place, 0
        self._stored = [Stored(sequence, cut.camera) for sequence in sequences]
        self._tables: list[Table] = [table_of(stored, cut) for stored in self._stored]
        self._ends = np.cumsum([len(table) for table in self._tables], dtype=np.int64)
        self.left_out = {
            "windows without a label": sum(table.without for table in self._tables),
            "sequences shorter than a window": sum(not len(t) and not t.without for t in self._tables),
        }
        if not len(self):
            raise DatasetError(self._why_none())

    def _why_none(self) -> str:
        if not self._stored:
            return f"{self._place} has no sequences; `evis dataset info` tells what failed"
        if without := self.left_out["windows without a label"]:
            rate = self._stored[0].info.keyframe_rate
            return (
                f"none of {without} windows of {self.cut.length} in {self._place} has all of the labels "
                f"{', '.join(self.cut.labels)}, which come {rate:g} times a second; make windows longer"
            )
        longest = max(stored.sequence.duration_ns for stored in self._stored) * 1e-9
        most = max(stored.sequence.count(stored.camera) for stored in self._stored)
        held = f"{longest:g} s" if self.cut.seconds else f"{most} events"
        return (
            f"windows of {self.cut.length} are longer than any sequence of {self._place} ({held} at most); shorten them"
        )

    def __len__(self) -> int:
        return int(self._ends[-1]) if len(self._ends) else 0

    def __getitem__(self, i: int) -> Sample:
        return self.sample(i, self.epoch)

    def __iter__(self) -> Iterator[Sample]:
        return (self[i] for i in range(len(self)))

    def __repr__(self) -> str:
        return f"Windows({len(self)} of {self.cut.length}, {len(self._stored)} sequences of {self._place!r})"

    def set_epoch(self, epoch: int) -> None:
        """Says which epoch it is, of which order and augmentation depend. Raises DatasetError."""
        check_whole("epoch", epoch)
        self.epoch = int(epoch)

    def sample(self, i: int, epoch: int) -> Sample:
        """Reads the i-th window as it is in an epoch. Raises TypeError, IndexError, DatasetError."""
        if not hasattr(i, "__index__"):  # a fraction would be cut off
            raise TypeError(f"a window is taken by its whole number, not by {i!r:.60}; several are by several calls")
        check_whole("epoch", epoch)
        at = operator.index(i) + (len(self) if i < 0 else 0)
        if not 0 <= at < len(self):
            raise IndexError(f"there is no window {i}; there are {len(self)}")
        n = int(np.searchsorted(self._ends, at, "right"))
        table = self._tables[n]
        window = table.window(at - int(self._ends[n]) + len(table))
        return contiguous(sample_of(self._stored[n], self.cut, window, epoch))

    def order(self, shuffle: bool, epoch: int, rank: int = 0, ranks: int = 1) -> np.ndarray:
        """Returns the numbers of the windows that a rank takes in an epoch, in their order. Raises DatasetError."""
        check_whole("epoch", epoch)
        check_place(rank, ranks)
        return share(order(len(self), shuffle, self.cut.seed, epoch), rank, ranks)

    def batches(
        self,
        size: int,
        *,
        shuffle: bool = False,
        epoch: int | None = None,
        rank: int = 0,
        ranks: int = 1,
        whole: bool = False,
    ) -> Iterator[dict[str, Any]]:
        """Gives batches of numpy arrays, joined by `evis.dataset.collate`.

        Args:
            size: windows of a batch. whole: leave out a last one that has fewer.
            shuffle: in an order of seed and epoch; else as they are.
            epoch: None = that of `set_epoch`.
            rank, ranks: take the part of one of several processes.

        Raises DatasetError.
        """
        check_size(size)
        epoch = self.epoch if epoch is None else epoch
        numbers = self.order(shuffle, epoch, rank, ranks)
        for first in range(0, len(numbers), size):
            part = numbers[first : first + size]
            if len(part) == size or not whole:
                yield collate([self.sample(int(i), epoch) for i in part])

    def torch(self) -> Any:
        """Returns a torch.utils.data.Dataset of them, for a DataLoader. Raises DatasetError without PyTorch."""
        return torch_module(TORCH).WindowDataset(self)

    def torch_iterable(self, *, shuffle: bool = False, rank: int | None = None, ranks: int | None = None) -> Any:
        """Returns a torch.utils.data.IterableDataset of them, whose workers and ranks share them.

        rank, ranks: not given, those of torch.distributed where it is initialised, else 0 of 1.

        Raises DatasetError without PyTorch.
        """
        return torch_module(TORCH).WindowIterable(self, shuffle, rank, ranks)


def torch_module(name: str) -> Any:
    """Returns a module that needs PyTorch. Raises DatasetError where it is not installed."""
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        if error.name != "torch":
            raise
        raise DatasetError("this needs PyTorch: pip install torch; without it go over `.batches(32)`") from None
