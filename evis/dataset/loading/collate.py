"""Joins samples to a batch; what differs in length is joined in a row, with offsets."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from evis.dataset.augmenting.arrays import module_of
from evis.dataset.errors import DatasetError
from evis.dataset.layouts.sample import EVENTS, TABLES

_OF_TABLES = {name: kind for kind, names in TABLES.items() for name in names} | {"class_id": "boxes"}
"""Array with a row for each box or contact -> its kind of label."""


def check_size(size: int) -> None:
    """Raises DatasetError for a size of batches that is no number of windows."""
    if isinstance(size, bool) or not isinstance(size, int | np.integer) or size < 1:
        raise DatasetError(f"batches are of {size!r} windows; it must be a whole number, 1 or more")


def collate(samples: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Joins samples of windows to a batch of B, for a DataLoader's collate_fn too.

    Arrays of equal shape get an axis B in front, numbers become int64 [B], texts a list. Events that are no image are
    joined to t, x, y, p [n] with `env_offsets` int64 [B + 1], as the functions of evis.events.representations take a
    batch; the labels of events go with them. Boxes and contacts are joined too, `boxes_offsets` [B + 1] delimits them.

    Samples of tensors make tensors on their device, those of numpy arrays numpy arrays. Raises DatasetError for images
    of different size, for no samples, and for samples that do not hold the same.
    """
    _check_alike(samples)
    batch: dict[str, Any] = {}
    for name, first in samples[0].items():
        values = [sample[name] for sample in samples]
        if isinstance(first, dict):
            batch[name] = {column: _joined([value[column] for value in values]) for column in first}
            batch[name]["env_offsets"] = _offsets([value["t"] for value in values])
        elif name in EVENTS:
            batch[name] = _joined(values)
        elif name in _OF_TABLES:
            batch[name] = _joined(values)
            batch[f"{_OF_TABLES[name]}_offsets"] = _offsets(values)
        elif hasattr(first, "shape"):
            batch[name] = _stacked(name, values)
        elif not isinstance(first, int):
            batch[name] = values
        else:
            batch[name] = _whole_numbers(values, _array_in(samples[0]))
    return batch


def _check_alike(samples: Any) -> None:
    """Raises DatasetError for what is no list of samples with the same names in them."""
    if not isinstance(samples, Sequence) or not all(isinstance(sample, dict) for sample in samples):
        raise DatasetError(f"collate joins a list of samples, dicts as windows[i] gives them, not {samples!r:.60}")
    if not samples:
        raise DatasetError("collate was given no samples; a batch has at least one")
    first = _names(samples[0])
    for number, sample in enumerate(samples):
        if other := sorted(first ^ _names(sample)):
            has, lacks = (0, number) if other[0] in first else (number, 0)
            raise DatasetError(
                f"sample {has} of a batch has '{other[0]}' and sample {lacks} has not; join samples of the same windows"
            )


def _names(sample: dict[str, Any]) -> set[str]:
    parts = {name: value for name, value in sample.items() if isinstance(value, dict)}
    return {*sample, *(f"{name}.{column}" for name, columns in parts.items() for column in columns)}


def _array_in(sample: dict[str, Any]) -> Any:
    """An array of a sample; one of numpy where it has none."""
    parts = [part for value in sample.values() for part in (value.values() if isinstance(value, dict) else [value])]
    return next((part for part in parts if hasattr(part, "shape")), np.empty(0))


def _joined(values: list[Any]) -> Any:
    return module_of(values[0]).concatenate(values)


def _offsets(values: list[Any]) -> Any:
    return _whole_numbers(np.concatenate([[0], np.cumsum([len(value) for value in values])]).tolist(), values[0])


def _whole_numbers(values: list[int], like: Any) -> Any:
    """int64, numpy's or PyTorch's; in the host's memory, as who reads such numbers is there."""
    if isinstance(like, np.ndarray):
        return np.array(values, np.int64)
    return module_of(like).tensor(values, dtype=module_of(like).int64)


def _stacked(name: str, values: list[Any]) -> Any:
    if len(shapes := {tuple(value.shape) for value in values}) > 1:
        sizes = " and ".join(str(list(shape)) for shape in sorted(shapes))
        raise DatasetError(
            f"{name} of a batch has the shapes {sizes}; Augment(crop=(height, width)) makes images of equal size"
        )
    return module_of(values[0]).stack(values)
