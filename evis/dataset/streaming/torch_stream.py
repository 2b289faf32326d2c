"""Offers what is simulated to PyTorch, as an iterable data set."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch.utils.data import IterableDataset

from evis.dataset.loading.torch_data import Epoch, place_among, tensors, worker

if TYPE_CHECKING:
    from evis.dataset.streaming.stream import Stream


class Simulated(IterableDataset[dict[str, Any]]):
    """Gives what a `Stream` simulates, in tensors, on the device that simulates. Each worker has its own sequences."""

    def __init__(self, stream: Stream, rank: int | None, ranks: int | None) -> None:
        self.stream, self._epoch = stream, Epoch()
        self._rank, self._ranks = place_among(rank, ranks)

    @property
    def left_out(self) -> dict[str, int]:
        """Counts what was left out so far, in this process, as of `Stream`."""
        return self.stream.left_out

    def set_epoch(self, epoch: int) -> None:
        """Says which epoch it is, as of `Stream`; workers that live on hear it too. Raises DatasetError."""
        self._epoch.set(epoch)

    def close(self) -> None:
        """Ends the simulations that are kept in this process."""
        self.stream.close()

    def __iter__(self) -> Iterator[dict[str, Any]]:
        number, workers = worker()
        place = self._rank * workers + number, self._ranks * workers
        for sample in self.stream.samples(*place, on_device, self._epoch.number):
            yield tensors(sample)


def on_device(array: Any) -> Any:
    """Returns an array of the simulation as it can be worked on where it lies: a tensor on a GPU, else numpy's."""
    if isinstance(array, np.ndarray):
        return array
    return torch.from_dlpack(array) if array.device.is_cuda else array.numpy()
