"""Writes labels of a bag as one archive: images stacked over time, tables with the rows of all messages."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any, BinaryIO

import numpy as np

from evis.bag import BagError, environments
from evis.bag.export.source import Messages
from msgs.camera import Labels
from msgs.fields import array_specs, environment_key

DENSE = tuple(name for name, spec in array_specs(Labels).items() if spec.dims[0] == "E")
"""One per message and environment, of the same shape in all of them."""


def _tables_of_labels() -> dict[str, tuple[str, ...]]:
    """Groups the arrays that have a row for each of something by what that is: box, box3d, contact, event."""
    tables: dict[str, tuple[str, ...]] = {}
    for name in array_specs(Labels):
        owner = environment_key(name, Labels)
        if owner and owner != name:
            kind = owner.removesuffix("_env")
            tables[kind] = (*tables.get(kind, ()), name)
    return tables


TABLES = _tables_of_labels()
"""As many rows in a message as there are boxes, contacts or events."""
COLUMNS = ("t", "x", "y", "p")
"""Columns of the labelled events, which the bag holds on a topic of their own."""


def write(messages: Messages, topic: str, out: BinaryIO, events: Messages | None = None) -> dict[str, Any]:
    """Writes an .npz of what the labels of T messages hold; one message is in memory at a time. Raises BagError.

    `t` int64 [T] ns and `episode` int64 [T]. `flow` [T, H, W, 2] px/s, `depth` [T, H, W] m, `segmentation` and
    `semantic` [T, H, W] ids, `pose` [T, N, 7] (p, q) and `velocity` [T, N, 6] (v, omega) of the N bodies that `names`
    lists. Of all boxes, in order of time: `box` [B, 4] x0 y0 x1 y1 px, `box_id` [B] and `box_t` int64 [B] ns; those of
    message k are box[box_offsets[k] : box_offsets[k + 1]]. So for contacts: `contact_body` [M, 2], `contact_position`,
    `contact_force` [M, 3], `contact_t`, `contact_offsets`, and for oriented boxes (`box3d_...`). Of events:
    `event_instance`, `event_flow`, `event_signal`, `event_offsets` and, out of the packets that `events` gives,
    `event_t` int64 ns, `event_x`, `event_y`, `event_p`. What was not asked for is not there.
    """
    found = _gathered(messages, topic)
    count = len(found.columns["t"])
    small = {name: np.array(values, np.int64) for name, values in found.columns.items()}
    small |= _stack_tables(found.rows, small["t"])
    if "event_instance" in small and events is not None:
        small |= _labelled_events(events, topic, len(small["event_instance"]))
    if found.names:
        small["names"] = np.array(found.names, str)
    with zipfile.ZipFile(out, "w") as archive:
        for name, array in small.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                np.lib.format.write_array(entry, array)
        for name, shaped in found.shapes.items():
            _stack(archive, name, (count, *shaped[0][0]), shaped[0][1], messages, topic)
    sizes = {name: list(array.shape) for name, array in small.items()}
    return {
        "messages": count,
        "arrays": sizes | {name: [count, *shaped[0][0]] for name, shaped in found.shapes.items()},
    }


@dataclass
class _Gathered:
    """Holds what is known of the labels of T stamps once all were read: columns, rows of tables, and the shapes and
    dtypes of the dense arrays, which are read again to be written."""

    columns: dict[str, list[Any]] = field(default_factory=lambda: {"t": [], "episode": []})
    rows: dict[str, list[np.ndarray]] = field(default_factory=dict)
    shapes: dict[str, list[tuple[tuple[int, ...], np.dtype]]] = field(default_factory=dict)
    names: list[str] | None = None


def _gathered(messages: Messages, topic: str) -> _Gathered:
    """Reads all labels but the dense arrays. Raises BagError where these are not of one shape, or not always there."""
    found = _Gathered()
    for label in _per_stamp(messages, topic):
        found.columns["t"].append(label.header.stamp_ns)
        found.columns["episode"].append(label.header.episode)
        if found.names is not None and found.names != label.names:
            raise BagError(f"{topic}: the bodies are others in later messages; export to .jsonl")
        found.names = list(label.names)
        if label.flow_t is not None:
            found.columns.setdefault("flow_t", []).append(np.array(label.flow_t))
        for name in DENSE:
            if (array := getattr(label, name)) is not None:
                found.shapes.setdefault(name, []).append((array.shape[1:], array.dtype))
        for fields in TABLES.values():
            for name in fields:
                if (array := getattr(label, name)) is not None:
                    found.rows.setdefault(name, []).append(np.array(array))
    count = len(found.columns["t"])
    there = {name: len(given) for name, given in found.shapes.items()} | {
        name: len(given) for name, given in found.rows.items()
    }
    for name, times in there.items():
        if times < count:
            raise BagError(f"{topic}: {name} is in {times} of {count} messages; export to .jsonl")
    for name, shaped in found.shapes.items():
        if len(set(shaped)) > 1:
            raise BagError(f"{topic}: the shape of {name} changes; export to .jsonl")
    return found


def _stack_tables(rows: dict[str, list[np.ndarray]], t: np.ndarray) -> dict[str, np.ndarray]:
    """Joins the rows of each table, with the time of each row and where those of each message begin."""
    result: dict[str, np.ndarray] = {}
    for kind, fields in TABLES.items():
        for name in fields:
            if name in rows:
                lengths = [len(part) for part in rows[name]]
                result[name] = np.concatenate(rows[name])
                if kind != "event":  # which have times of their own
                    result[f"{kind}_t"] = np.repeat(t, lengths)
                result[f"{kind}_offsets"] = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
    return result


def _labelled_events(packets: Messages, topic: str, count: int) -> dict[str, np.ndarray]:
    """Reads the columns of the labelled events. Raises BagError where the packets have other events."""
    parts: dict[str, list[np.ndarray]] = {name: [] for name in COLUMNS}
    for packet in packets():
        for name in COLUMNS:
            parts[name].append(np.array(getattr(packet, name)))
    found = {f"event_{name}": np.concatenate(pieces) for name, pieces in parts.items() if pieces}
    if len(found.get("event_t", ())) != count:
        raise BagError(f"{topic} labels {count} events, the bag has {len(found.get('event_t', ()))}; export to .jsonl")
    return found


def _stack(
    archive: zipfile.ZipFile, name: str, shape: tuple[int, ...], dtype: np.dtype, messages: Messages, topic: str
) -> None:
    with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
        about = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": shape}
        np.lib.format.write_array_header_1_0(entry, about)
        for label in _per_stamp(messages, topic):
            entry.write(np.ascontiguousarray(getattr(label, name)[0], dtype).tobytes())


def _per_stamp(messages: Messages, topic: str) -> Iterator[Labels]:
    """Yields the labels of each stamp; where a sensor looked ahead, those of its last packet join the others."""
    last: Labels | None = None
    for label in _checked(messages, topic):
        if last is not None and (last.header.stamp_ns, last.header.episode) == (
            label.header.stamp_ns, label.header.episode,
        ):  # fmt: skip
            both = [(n, getattr(last, n), getattr(label, n)) for n in (*TABLES["event"], "event_env")]
            joined: dict[str, Any] = {n: np.concatenate((a, b)) for n, a, b in both if a is not None and b is not None}
            last = replace(last, **joined)
            continue
        if last is not None:
            yield last
        last = label
    if last is not None:
        yield last


def _checked(messages: Messages, topic: str) -> Iterator[Labels]:
    for message in messages():
        if not isinstance(message, Labels):
            raise BagError(f"{topic} holds {type(message).__name__} messages, no labels")
        owners = [getattr(message, f"{kind}_env") for kind in TABLES]
        tables = [a for a in owners if a is not None and len(a)]
        if environments.count(message) > 1 or any(int(a.max()) > 0 for a in tables):
            raise BagError(f"{topic} has several environments; name one of them: /env0{topic}")
        yield message
