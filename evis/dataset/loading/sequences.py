"""Opens a data set: its sequences, by number and by split."""

from __future__ import annotations

import operator
import os
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, overload

import numpy as np

from evis.config.suggestions import nearest
from evis.dataset.about import About
from evis.dataset.errors import DatasetError
from evis.dataset.loading.cut import Cut
from evis.dataset.loading.recognised import is_sequence, layout_of
from evis.dataset.loading.sequence import Sequence
from evis.dataset.loading.windows import Windows
from evis.dataset.making.store import is_remote
from evis.dataset.report.summary import opened


class Sequences:
    """Holds the sequences of a data set, in the order of dataset.json, or some of them."""

    def __init__(self, place: str, sequences: list[Sequence]) -> None:
        """place: the data set's, as it was named."""
        self.place = place
        self._all = sequences

    def __len__(self) -> int:
        return len(self._all)

    @overload
    def __getitem__(self, which: int) -> Sequence: ...
    @overload
    def __getitem__(self, which: slice | Iterable[int]) -> Sequences: ...
    def __getitem__(self, which: int | slice | Iterable[int]) -> Sequence | Sequences:
        if isinstance(which, slice):
            return Sequences(self.place, self._all[which])
        if isinstance(which, Iterable) and not isinstance(which, str):
            return Sequences(self.place, [self._one(number) for number in which])
        return self._one(which)

    def _one(self, which: Any) -> Sequence:
        """The sequence of a number, from the end where it is negative. Raises TypeError, IndexError."""
        if isinstance(which, bool | np.bool_):
            raise TypeError("sequences are taken by their numbers, not by a mask; np.flatnonzero(mask) gives them")
        if not hasattr(which, "__index__"):
            raise TypeError(
                f"sequences are taken by number, slice or a list of numbers, not by {which!r:.60}; go over them for "
                "what else they are chosen by, as their arguments"
            )
        if not -len(self) <= (number := operator.index(which)) < len(self):
            raise IndexError(f"there is no sequence {number}; there are {len(self)}")
        return self._all[number]

    def __iter__(self) -> Iterator[Sequence]:
        return iter(self._all)

    def __repr__(self) -> str:
        splits = ", ".join(f"{name} {count}" for name, count in self.splits.items() if name)
        return f"Sequences({self.place!r}, {len(self)}{f': {splits}' if splits else ''})"

    @property
    def splits(self) -> dict[str, int]:
        """Counts the sequences of each split."""
        return dict(Counter(sequence.split for sequence in self._all))

    def split(self, name: str) -> Sequences:
        """Takes the sequences of one split. Raises DatasetError that names the nearest one."""
        if name not in self.splits:
            raise DatasetError(f"{self.place} has no split '{name}'; {nearest(name, self.splits)}")
        return Sequences(self.place, [sequence for sequence in self._all if sequence.split == name])

    def windows(self, **how: Any) -> Windows:
        """Cuts all of them into windows; the arguments are those of `evis.dataset.loading.cut.Cut.of`."""
        return Windows(self._all, Cut.of(**how), self.place)


def open_dataset(place: str | Path) -> Sequences:
    """Opens a data set, or the folder of one sequence, to read from.

    place: a folder that `evis dataset make` has written, here or where fsspec reaches (s3://bucket/folder), or that of
    a single sequence: one of a data set, or what `evis bag export --layout` has made of a bag.

    Raises DatasetError for a place that holds neither.
    """
    name = str(place).rstrip("/") if is_remote(str(place)) else os.path.abspath(place)
    if not is_remote(name):
        folder = Path(name)
        if folder.is_file():
            raise DatasetError(
                f"{place} is a file, and a data set is a folder; evis.open reads recordings and bags, and `evis bag "
                f"export {place} --layout npz DIR` makes a folder of a bag"
            )
        if not folder.is_dir():
            raise DatasetError(f"there is no folder {place}; `evis dataset make RECIPE --out {place}` makes a data set")
        if is_sequence(folder):
            return Sequences(str(place), [_single(folder)])
    _, index = opened(name)
    layout = index["layout"]
    return Sequences(str(place), [Sequence(name, entry["path"], layout, entry) for entry in index["sequences"]])


def _single(folder: Path) -> Sequence:
    """A sequence that lies by itself."""
    try:
        about = About.load(folder)
    except ValueError as error:
        raise DatasetError(str(error)) from None
    entry = {"index": 0, "split": "", "name": about.name, "scene": about.scene, "seed": about.seed}
    return Sequence(str(folder.parent), folder.name, layout_of(folder), {**entry, "arguments": dict(about.arguments)})
