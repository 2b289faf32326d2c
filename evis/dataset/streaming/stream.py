"""Simulates training data while they are used: the windows of a recipe's sequences, without files."""

from __future__ import annotations

import itertools
import os
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from evis.config.suggestions import nearest
from evis.dataset.draws import key_of, uniform
from evis.dataset.errors import DatasetError
from evis.dataset.loading.collate import check_size, collate
from evis.dataset.loading.cut import Cut, check_whole
from evis.dataset.loading.order import given_place
from evis.dataset.loading.sample import Sample, contiguous, sample_of
from evis.dataset.loading.windows import torch_module
from evis.dataset.making.make import check
from evis.dataset.making.warm import Warm
from evis.dataset.recipe import Plan, Recipe
from evis.dataset.recipe_file import read_recipe
from evis.dataset.streaming.live import Live
from evis.gpu.host_copies import host_array
from evis.simulation.errors import SimulationError, SimulationWarning

TORCH = "evis.dataset.streaming.torch_stream"
FRUITLESS = 5
"""So many sequences in a row without a window are no chance."""
OUTPUTS = {"depth": "depth", "segmentation": "ids", "image": "image"}
"""Labels that outputs of the simulation bring too."""


class Stream:
    """Simulates the sequences of a recipe, one after the other, and gives their windows, in numpy's arrays.

    It keeps simulations warm as `evis dataset make` does, and the windows are those of the data set that this makes.

    left_out: what was left out so far, in this process: windows without a label, and sequences that failed.
    """

    def __init__(
        self, recipe: Recipe, cut: Cut, sequences: int | None, first: int, split: str | None, device: str | None,
        shuffle: int, place: tuple[int, int] | None = None,
    ) -> None:  # fmt: skip
        """See `stream`. place: rank and number of ranks. Raises DatasetError for what the recipe does not make."""
        self.recipe, self.cut = recipe, cut
        self._sequences, self._first, self._split, self._device = sequences, first, split, device
        self._shuffle = int(shuffle)
        self._place = place or (0, 1)
        self._warm: tuple[int, Warm] | None = None
        self._epoch = 0
        self.left_out = {"windows without a label": 0, "sequences that failed": 0}
        wanted = {*cut.labels, *cut.augment.counterparts(cut.labels).values()}
        there = {*recipe.labels, *(kind for kind, output in OUTPUTS.items() if output in recipe.outputs)}
        if missing := sorted(wanted - there):
            raise DatasetError(
                f"{recipe.name} makes no labels '{missing[0]}'; it makes {', '.join(sorted(there)) or 'none'}: "
                "add it to `labels:` of the recipe"
            )
        if split is not None and split not in recipe.splits:
            raise DatasetError(f"{recipe.name} has no split '{split}'; {nearest(split, recipe.splits)}")
        if split is not None and not recipe.makes(split):  # it would be looked for without end
            share = f"a share of {recipe.splits[split]:g}"
            raise DatasetError(f"the split '{split}' of {recipe.name} has {share}: no sequence is ever in it")
        longest = float(max(recipe.duration.choices or recipe.duration.high))
        if cut.seconds > longest:
            raise DatasetError(f"windows of {cut.length} are longer than the sequences of {recipe.name}, {longest:g} s")
        self._labels = tuple(kind for kind in recipe.labels if kind in wanted)
        check(recipe)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_warm": None}

    def __iter__(self) -> Iterator[Sample]:
        return self.samples(*self._place, epoch=self._epoch)

    def set_epoch(self, epoch: int) -> None:
        """Says which epoch it is, on which augmentation and the order of `shuffle` depend; the sequences are the same.

        Raises DatasetError.
        """
        check_whole("epoch", epoch)
        self._epoch = int(epoch)

    def batches(self, size: int) -> Iterator[dict[str, Any]]:
        """Gives batches of windows, joined by `evis.dataset.collate`; the last may have fewer. Raises DatasetError."""
        check_size(size)
        samples = iter(self)
        while batch := list(itertools.islice(samples, size)):
            yield collate(batch)

    def samples(
        self, worker: int, workers: int, taken: Callable[[Any], Any] = host_array, epoch: int = 0
    ) -> Iterator[Sample]:
        """Yields the windows of the sequences of one of several workers, as they are in an epoch.

        taken: makes of an array of the simulation what windows are to have.
        """
        own = self._own(worker, workers, taken, epoch)
        if not self._shuffle:
            yield from own
            return
        held: list[Sample] = []
        key = key_of(self.cut.seed, "shuffle", epoch, worker)
        for n, sample in enumerate(own):
            if len(held) < self._shuffle:
                held.append(sample)
                continue
            at = int(uniform(key, n) * len(held))
            held[at], sample = sample, held[at]
            yield sample
        for n in range(len(held)):
            yield held.pop(int(uniform(key_of(key, "rest"), n) * len(held)))

    def _own(self, worker: int, workers: int, taken: Callable[[Any], Any], epoch: int) -> Iterator[Sample]:
        fruitless, why, fruit = 0, "", False
        for plan in itertools.islice(self._plans(), worker, None, workers):
            before = dict(self.left_out)
            windows = 0
            try:
                for sample in self._simulated(plan, taken, epoch):
                    windows += 1
                    yield sample
            except SimulationError as error:
                self.left_out["sequences that failed"] += 1
                why = f"{plan.name}: {error}"
                warnings.warn(f"{why}; its other windows are left out", SimulationWarning, stacklevel=2)
            if self.left_out == before:
                why = f"{plan.name} is shorter than a window of {self.cut.length}"
            elif self.left_out["sequences that failed"] == before["sequences that failed"]:
                why = f"windows of {self.cut.length} have no labels {', '.join(self.cut.labels)}; make them longer"
            fruitless, fruit = 0 if windows else fruitless + 1, fruit or windows > 0
            if fruitless == FRUITLESS:
                raise DatasetError(f"{FRUITLESS} sequences in a row gave no window: {why}")
        if fruitless and not fruit and workers == 1:  # one of several workers may have the short ones alone
            raise DatasetError(f"none of {fruitless} sequences gave a window: {why}")

    def _plans(self) -> Iterator[Plan]:
        numbers = itertools.count(self._first)
        plans = (plan for n in numbers if self._split in (None, (plan := self.recipe.sequence(n)).split))
        device = {} if self._device is None else {"device": self._device}
        for plan in itertools.islice(plans, self._sequences):
            yield replace(plan, labels=self._labels, arguments={**plan.arguments, **device})

    def _simulated(self, plan: Plan, taken: Callable[[Any], Any], epoch: int) -> Iterator[Sample]:
        """Yields the windows of a sequence."""
        if self._warm is None or self._warm[0] != os.getpid():  # a forked worker makes its own
            self._warm = os.getpid(), Warm()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SimulationWarning)  # as when a data set is made
            with self._warm[1].play(plan) as playing:
                live = Live(plan, playing, self.cut, taken)
                for window in live.windows():
                    yield contiguous(sample_of(live, self.cut, window, epoch))
                self.left_out["windows without a label"] += live.left_out

    def close(self) -> None:
        """Ends the simulations that are kept."""
        if self._warm is not None and self._warm[0] == os.getpid():
            self._warm[1].close()
        self._warm = None


def stream(
    recipe: str | Path | Recipe,
    *,
    sequences: int | None = None,
    first: int = 0,
    split: str | None = None,
    duration_s: float | None = None,
    device: str | None = None,
    shuffle: int = 0,
    arrays: str | None = None,
    rank: int | None = None,
    ranks: int | None = None,
    **how: Any,
) -> Any:
    """Simulates a recipe's sequences while they are used, without files; windows are those of the data set it makes.

    Args:
        recipe: its name or path, or what `read_recipe` has read.
        sequences: how many, from the number `first` on; None = without end.
        split: sequences of one split alone.
        duration_s: of each sequence, in place of what the recipe says.
        device: of the simulation, `cuda`, in place of what the recipe says. Batches stay there.
        shuffle: windows that wait until a drawn one of them is given; 0 = in order of time.
        arrays: torch, an IterableDataset for a DataLoader, or numpy, a `Stream`; None = torch where it is installed.
        rank, ranks: of several processes that share the sequences; None = those of torch.distributed where the stream
            is PyTorch's, or 0 of 1.
        how: windows, as `Sequences.windows` has them.

    Raises DatasetError, and what `read_recipe` raises.
    """
    if arrays not in (None, "torch", "numpy"):
        raise DatasetError(f"arrays is '{arrays}'; it is torch or numpy")
    for name, value in (("sequences", sequences), ("first", first), ("shuffle", shuffle)):
        if value is not None:
            check_whole(name, value, 0)
    place = given_place(rank, ranks)
    read = recipe if isinstance(recipe, Recipe) else read_recipe(recipe, duration_s)
    made = Stream(read, Cut.of(**how), sequences, first, split, device, shuffle, place)
    if arrays == "numpy":
        return made
    try:
        return torch_module(TORCH).Simulated(made, rank, ranks)
    except DatasetError:
        if arrays == "torch":
            raise
        return made
