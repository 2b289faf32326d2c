"""Where the events are in an HDF5 file, by who wrote it."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import h5py
import numpy as np

from evis.streams.events import Events, Triggers
from evis.streams.files import ecf
from evis.streams.files.inflate import DamagedError
from evis.streams.recording import RecordingError, RecordingInfo

_COLUMNS = (("x", "y", "t", "p"), ("xs", "ys", "ts", "ps"))
_MAX_CHUNK = 1 << 26
_MOST_EVENTS_A_BYTE = 4096


@dataclass
class Layout:
    """count: events. read(a, b): events a..b-1. time_at(i): [ns]. size(): width, height, where from; 0 = unknown.
    block: events that are compressed together, where a damaged one is to be left out alone."""

    name: str
    count: int
    read: Callable[[int, int], Events]
    time_at: Callable[[int], int]
    size: Callable[[], tuple[int, int, str]]
    triggers: Callable[[], Triggers] | None = None
    block: int = 0


def find_layout(file: h5py.File, topic: str, info: RecordingInfo, backend: str) -> Layout:
    """The layout of an open file. topic: the group with the events, where there are several.

    Raises RecordingError, and ValueError where there are no events.
    """
    table = _get(file, "CD/events")
    compound = isinstance(table, h5py.Dataset) and bool(table.dtype.names)
    if compound and topic.strip("/") in ("", "CD", "CD/events"):
        return _prophesee(file, table, backend)
    groups: list[str] = ["CD/events"] if compound else []
    file.visititems(lambda name, item: groups.append(name) if _holds_events(item) else None)
    if not groups:
        raise ValueError("an HDF5 file without events: no CD/events, no x, y, t, p, no N x 4 events")
    if topic and topic not in groups:
        raise RecordingError(f"{info.path}: no events in '{topic}'; they are in {', '.join(groups)}")
    name = topic or groups[0]
    if len(groups) > 1 and not topic:
        info.warn(f"events in {', '.join(groups)}: these are of {name}")
    found = file[name]
    return _table(found) if isinstance(found, h5py.Dataset) else _columns(file, found)


def _get(group: Any, name: str) -> Any:
    try:
        return group.get(name)
    except (KeyError, RuntimeError, OSError):
        return None


def _holds_events(item: Any) -> bool:
    if isinstance(item, h5py.Dataset):
        return item.ndim == 2 and item.shape[1] == 4 and item.name.rpartition("/")[2] == "events"
    return any(all(isinstance(_get(item, n), h5py.Dataset) for n in names) for names in _COLUMNS)


# -- Prophesee ---------------------------------------------------------------------------------------------------------


def _prophesee(file: h5py.File, table: h5py.Dataset, backend: str) -> Layout:
    names = set(table.dtype.names or ())
    if not {"x", "y", "t", "p"} <= names or table.ndim != 1:
        raise RecordingError(f"{file.filename}: CD/events has the fields {', '.join(sorted(names))}, not x, y, p, t")
    creation = table.id.get_create_plist()
    filters = [creation.get_filter(i)[0] for i in range(creation.get_nfilters())]
    chunk = table.chunks[0] if table.chunks else 0
    if filters and ecf.FILTER in filters and (filters != [ecf.FILTER] or not 0 < chunk <= _MAX_CHUNK):
        raise RecordingError(f"{file.filename}: CD/events has ECF among other filters or in chunks of {chunk} events")
    if backend == "auto":
        backend = "warp" if table.shape[0] > 1 << 20 else "numpy"

    def whole(a: int, b: int) -> Events:
        if ecf.FILTER in filters:
            return _ecf_chunk(table, a, b, backend)
        rows = table[a:b]
        return _events(rows["t"], rows["x"], rows["y"], rows["p"], 1000)

    def time_at(i: int) -> int:
        a = i - i % chunk if ecf.FILTER in filters else i
        return int(whole(a, min(a + (chunk or 1), table.shape[0])).t[i - a])

    def size() -> tuple[int, int, str]:
        text = file.attrs.get("geometry", b"")
        text = text.decode(errors="replace") if isinstance(text, bytes) else str(text)
        found = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text)
        width, height = (int(found[1]), int(found[2])) if found else (0, 0)
        return (width, height, "header") if width and height else (0, 0, "")

    def triggers() -> Triggers:
        edges = _get(file, "EXT_TRIGGER/events")
        if not isinstance(edges, h5py.Dataset) or not edges.size or edges.size > _MAX_CHUNK:
            return Triggers()
        rows = edges[:]
        return Triggers(
            rows["t"].astype(np.int64) * 1000, rows["id"].astype(np.uint8), (rows["p"] > 0).astype(np.uint8)
        )

    _check_claim(table.shape[0], [table])
    name = "ecf" if ecf.FILTER in filters else "compound"
    return Layout(name, table.shape[0], whole, time_at, size, triggers, chunk if ecf.FILTER in filters else 0)


def _ecf_chunk(table: h5py.Dataset, a: int, b: int, backend: str) -> Events:
    mask, data = table.id.read_direct_chunk((a,))
    if mask & 1:
        rows = np.frombuffer(data, table.dtype)
        return _events(rows["t"], rows["x"], rows["y"], rows["p"], 1000)[: b - a]
    try:
        t, x, y, p = ecf.decode(data, backend)
    except DamagedError as error:
        raise ValueError(str(error)) from None
    return Events(t * 1000, x, y, p)[: b - a]


# -- columns -----------------------------------------------------------------------------------------------------------


def _columns(file: h5py.File, group: h5py.Group) -> Layout:
    with contextlib.suppress(ImportError):
        import hdf5plugin  # noqa: F401 (registers the compressions that DSEC and TUM-VIE use)
    names = next(n for n in _COLUMNS if all(isinstance(_get(group, c), h5py.Dataset) for c in n))
    x, y, t, p = (group[n] for n in names)
    offset_us = 0
    offset = _get(file, "t_offset")
    if isinstance(offset, h5py.Dataset) and offset.size == 1:
        offset_us = int(np.asarray(offset[()]).reshape(-1)[0])
    indexed = any(isinstance(_get(g, "ms_to_idx"), h5py.Dataset) for g in (file, group))
    name = ("dsec" if offset is not None else "tum-vie") if indexed else "columns"
    count = min(d.shape[0] if d.ndim == 1 else 0 for d in (x, y, t, p))
    _check_claim(count, [x, y, t, p])

    def times(values: np.ndarray) -> np.ndarray:
        if values.dtype.kind == "f":
            return np.rint(values.astype(np.float64) * 1e9).astype(np.int64)
        return (values.astype(np.int64) + offset_us) * 1000

    def read(a: int, b: int) -> Events:
        return _events(times(t[a:b]), x[a:b], y[a:b], p[a:b], 1)

    def size() -> tuple[int, int, str]:
        given = file.attrs.get("sensor_resolution")
        if given is not None and np.shape(given) == (2,):
            height, width = sorted(int(v) for v in given)
            return width, height, "header"
        known = {"dsec": (640, 480), "tum-vie": (1280, 720)}.get(name)
        n = min(count, 1 << 20)
        fits = known and (not n or (int(x[:n].max()) < known[0] and int(y[:n].max()) < known[1]))
        return (*known, "sensor") if known and fits else (0, 0, "")

    return Layout(name, count, read, lambda i: int(times(t[i : i + 1])[0]), size)


def _table(table: h5py.Dataset) -> Layout:
    """MVSEC: rows of x, y, t [s], p (-1 or 1) as float64."""

    def times(values: np.ndarray) -> np.ndarray:
        # whole seconds apart: their product with 1e9 would be rounded to 256 ns
        whole = np.floor(values)
        return whole.astype(np.int64) * 1_000_000_000 + np.rint((values - whole) * 1e9).astype(np.int64)

    def read(a: int, b: int) -> Events:
        rows = table[a:b].astype(np.float64)
        if not np.isfinite(rows).all() or (np.abs(rows) > 1e10).any():
            raise ValueError("values that are no events")
        return _events(times(rows[:, 2]), rows[:, 0].astype(np.int64), rows[:, 1].astype(np.int64), rows[:, 3], 1)

    def size() -> tuple[int, int, str]:
        n = min(table.shape[0], 1 << 20)
        fits = "davis" in table.name and n and (table[:n, :2].max(0) < (346, 260)).all()
        return (346, 260, "sensor") if fits else (0, 0, "")

    _check_claim(table.shape[0], [table])
    return Layout("mvsec", table.shape[0], read, lambda i: int(times(table[i : i + 1, 2])[0]), size)


def _check_claim(count: int, tables: list[h5py.Dataset]) -> None:
    """No compression makes this little of so many events: a damaged number must not keep a reader busy for ever."""
    stored = sum(table.id.get_storage_size() for table in tables)
    if count > _MOST_EVENTS_A_BYTE * stored:
        raise ValueError(f"damaged: {count} events in {stored} bytes")


def _events(t: Any, x: Any, y: Any, p: Any, unit: int) -> Events:
    """Columns of any number type; what does not fit uint16 becomes 65535 and so falls outside of every sensor."""
    a, b = [np.where((np.asarray(v) < 0) | (np.asarray(v) > 65535), 65535, v).astype(np.uint16) for v in (x, y)]
    return Events(t.astype(np.int64) * unit, a, b, (np.asarray(p) > 0).astype(np.uint8))
