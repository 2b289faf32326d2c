"""Labels out of a bag as one archive: images stacked over time, tables of rows one after the other."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Iterator
from typing import Any, BinaryIO

import numpy as np

from evis.bag import BagError
from msgs.camera import Labels
from msgs.header import Message

Messages = Callable[[], Iterator[Message]]
"""Gives the messages of a topic from the start, each of one environment."""
DENSE = ("flow", "depth", "segmentation", "semantic", "pose", "velocity")
"""One per message and environment, of the same shape in all of them."""
TABLES = {"box": ("box", "box_id"), "contact": ("contact_body", "contact_position", "contact_force")}
"""As many rows in a message as there are boxes or contacts."""


def write(messages: Messages, topic: str, out: BinaryIO) -> dict[str, Any]:
    """Writes an .npz of what the labels of T messages hold; one message is in memory at a time. Raises BagError.

    `t` int64 [T] ns and `episode` int64 [T]. `flow` [T, H, W, 2] px/s, `depth` [T, H, W] m, `segmentation` and
    `semantic` [T, H, W] ids, `pose` [T, N, 7] (p, q) and `velocity` [T, N, 6] (v, omega) of the N bodies that `names`
    lists. Of all boxes, in order of time: `box` [B, 4] x0 y0 x1 y1 px, `box_id` [B] and `box_t` int64 [B] ns; those of
    message k are box[box_offsets[k] : box_offsets[k + 1]]. So for contacts: `contact_body` [M, 2], `contact_position`,
    `contact_force` [M, 3], `contact_t`, `contact_offsets`. What was not asked for is not there.
    """
    columns: dict[str, list[Any]] = {"t": [], "episode": []}
    rows: dict[str, list[np.ndarray]] = {}
    shapes: dict[str, list[tuple[tuple[int, ...], np.dtype]]] = {}
    names: list[str] | None = None
    for label in _each(messages, topic):
        columns["t"].append(label.header.stamp_ns)
        columns["episode"].append(label.header.episode)
        if names is not None and names != label.names:
            raise BagError(f"{topic}: the bodies are others in later messages; export to .jsonl")
        names = list(label.names)
        for name in DENSE:
            if (array := getattr(label, name)) is not None:
                shapes.setdefault(name, []).append((array.shape[1:], array.dtype))
        for fields in TABLES.values():
            for name in fields:
                if (array := getattr(label, name)) is not None:
                    rows.setdefault(name, []).append(np.array(array))
    count = len(columns["t"])
    there = {name: len(found) for name, found in shapes.items()} | {name: len(found) for name, found in rows.items()}
    for name, found in there.items():
        if found < count:
            raise BagError(f"{topic}: {name} is in {found} of {count} messages; export to .jsonl")
    for name, shaped in shapes.items():
        if len(set(shaped)) > 1:
            raise BagError(f"{topic}: the shape of {name} changes; export to .jsonl")
    small = {name: np.array(values, np.int64) for name, values in columns.items()}
    small |= _tables(rows, small["t"])
    if names:
        small["names"] = np.array(names, str)
    with zipfile.ZipFile(out, "w") as archive:
        for name, array in small.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                np.lib.format.write_array(entry, array)
        for name, shaped in shapes.items():
            _stack(archive, name, (count, *shaped[0][0]), shaped[0][1], messages, topic)
    sizes = {name: list(array.shape) for name, array in small.items()}
    return {"messages": count, "arrays": sizes | {name: [count, *shaped[0][0]] for name, shaped in shapes.items()}}


def _tables(rows: dict[str, list[np.ndarray]], t: np.ndarray) -> dict[str, np.ndarray]:
    """All rows of each table, with the time of each and where those of each message begin."""
    result: dict[str, np.ndarray] = {}
    for kind, fields in TABLES.items():
        for name in fields:
            if name in rows:
                lengths = [len(part) for part in rows[name]]
                result[name] = np.concatenate(rows[name])
                result[f"{kind}_t"] = np.repeat(t, lengths)
                result[f"{kind}_offsets"] = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
    return result


def _stack(
    archive: zipfile.ZipFile, name: str, shape: tuple[int, ...], dtype: np.dtype, messages: Messages, topic: str
) -> None:
    with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
        about = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": shape}
        np.lib.format.write_array_header_1_0(entry, about)
        for label in _each(messages, topic):
            entry.write(np.ascontiguousarray(getattr(label, name)[0], dtype).tobytes())


def _each(messages: Messages, topic: str) -> Iterator[Labels]:
    from evis.bag import environments

    for message in messages():
        if not isinstance(message, Labels):
            raise BagError(f"{topic} holds {type(message).__name__} messages, no labels")
        tables = [a for a in (message.box_env, message.contact_env) if a is not None and len(a)]
        if environments.count(message) > 1 or any(int(a.max()) > 0 for a in tables):
            raise BagError(f"{topic} has several environments; name one of them: /env0{topic}")
        yield message
