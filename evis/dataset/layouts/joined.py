"""Joins labels that are kept stamp by stamp into the arrays that a reader gives."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from evis.dataset.layouts.sample import DENSE, EVENTS, TABLES
from msgs.camera import CameraInfo, Labels
from msgs.fields import array_specs

Pieces = Sequence[tuple[int, dict[str, np.ndarray]]]
"""(stamp, arrays by name), in order of time."""


def joined(kind: str, pieces: Pieces, info: CameraInfo) -> dict[str, np.ndarray]:
    """Returns what `SequenceReader.labels` gives of a kind of DENSE or TABLES; without pieces, arrays of no rows."""
    found = {"t": np.array([stamp for stamp, _ in pieces], np.int64)}
    for name in (*DENSE.get(kind, ()), *TABLES.get(kind, ())):
        parts = [arrays[name] for _, arrays in pieces]
        if kind in TABLES:
            lengths = [len(part) for part in parts]
            found["offsets"] = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
            found[name] = np.concatenate([no_rows(name, info), *parts])
        else:
            found[name] = np.stack(parts) if parts else no_rows(name, info)
    return found


def no_rows(name: str, info: CameraInfo) -> np.ndarray:
    """Returns an array of msgs' Labels as it is of no stamp, without the axis of the environments."""
    spec = array_specs(Labels)[name]
    sizes = {"H": info.height, "W": info.width}
    dims = spec.dims if name == "flow_t" else spec.dims[1:]
    return np.empty((0, *(d if isinstance(d, int) else sizes.get(d, 0) for d in dims)), spec.dtypes[0])


def of_events(t: np.ndarray, arrays: dict[str, np.ndarray], part: slice) -> dict[str, np.ndarray]:
    """Returns the labels of some events, beside their times."""
    return {"t": t[part], **{name: arrays[name][part] for name in EVENTS}}
