"""Opens a data set: its sequences, by number and by split."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, overload

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
    def __getitem__(self, which: slice) -> Sequences: ...
    def __getitem__(self, which: int | slice) -> Sequence | Sequences:
        if isinstance(which, slice):
            return Sequences(self.place, self._all[which])
        return self._all[which]

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
