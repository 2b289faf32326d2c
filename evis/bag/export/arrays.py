"""Writes the arrays of messages of any kind as one archive."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, BinaryIO

import numpy as np

from evis.bag import BagError
from msgs.fields import array_specs
from msgs.header import Message

SAMPLES = ("n", "w")
"""Axes, as messages name them, of which each message has a length of its own."""


def write(messages: Iterable[Message], topic: str, out: BinaryIO) -> dict[str, Any]:
    """Writes an .npz of `stamp_ns` and `episode`, int64 [T], and the arrays of T messages, stacked.

    Arrays whose first axis is of SAMPLES are joined; those of message k are rows offsets[k] to offsets[k + 1]. Raises
    BagError where the messages differ in their arrays or shapes.
    """
    columns: dict[str, list[np.ndarray]] = {"stamp_ns": [], "episode": []}
    rows: dict[str, list[int]] = {}
    for i, message in enumerate(messages):
        columns["stamp_ns"].append(np.array(message.header.stamp_ns, np.int64))
        columns["episode"].append(np.array(message.header.episode, np.int64))
        for name, array in message.arrays().items():
            columns.setdefault(name, [])
            joined = array_specs(type(message))[name].dims[0] in SAMPLES
            if joined:
                rows.setdefault(name, []).append(len(array))
            if len(columns[name]) != i or (i and columns[name][0].shape[joined:] != array.shape[joined:]):
                raise BagError(f"{topic}: {name} has another shape in every message; export to .jsonl")
            columns[name].append(np.asarray(array))
    if len({len(v) for v in columns.values()}) > 1:
        raise BagError(f"{topic}: not every message has the same arrays; export to .jsonl")
    stacked = {
        n: (np.concatenate if n in rows else np.stack)(v) if v else np.empty(0, np.int64) for n, v in columns.items()
    }
    if rows:  # of all arrays with such an axis alike
        stacked["offsets"] = np.cumsum([0, *next(iter(rows.values()))], dtype=np.int64)
    np.savez(out, **stacked)  # type: ignore[arg-type]
    return {"messages": len(stacked["stamp_ns"]), "arrays": {n: list(v.shape) for n, v in stacked.items()}}
