"""Finds where the events are in an HDF5 file, in the layout of the program that wrote it."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import h5py
import numpy as np

from evis.events.arrays import Events, Triggers
from evis.events.files.hdf5 import ecf
from evis.events.files.hdf5.cut import Parts, common, rows_there
from evis.events.files.hdf5.ecf_layout import FILTER
from evis.events.files.hdf5.table import Table, member
from evis.events.files.numpy_files.npy import LOOK, NAMES, NS_FROM, is_whole, seconds_in_ns
from evis.events.files.reading.decompress import DamagedError
from evis.events.recording import RecordingError, RecordingInfo
from evis.files.allowance import Allowance

_MAX_CHUNK = 1 << 26
_MOST_EVENTS_A_BYTE = 4096
_MOST_OBJECTS, _DEEPEST = 10_000, 8


@dataclass
class Layout:
    """Describes where the events of a file are. count: events.

    tables: where they are. read(a, b): events a..b-1. time_at(i): [ns].

    size(): width, height, where from; 0 = unknown. block: events that are compressed together, where a damaged one is
    to be left out alone. read_cut(a, data): the events of a chunk from event a on of which only `data` is there.
    """

    name: str
    count: int
    tables: list[Table]
    read: Callable[[int, int], Events]
    time_at: Callable[[int], int]
    size: Callable[[], tuple[int, int, str]]
    triggers: Callable[[], Triggers] | None = None
    block: int = 0
    read_cut: Callable[[int, bytes], Events] | None = None

    def there(self, end: int, first: int, last: int) -> Parts:
        """Finds which of the events first..last-1 lie before byte `end` of the file."""
        parts = [(first, last)]
        for table in self.tables:
            parts = common(parts, rows_there(table, end, first, last))
        return parts


def find_layout(file: h5py.File, topic: str, info: RecordingInfo, backend: str) -> Layout:
    """Finds the layout of an open file. topic: the group with the events, where there are several.

    Raises RecordingError, and ValueError where there are no events.
    """
    table = member(file, "CD/events", info)
    compound = isinstance(table, Table) and bool(table.dtype.names)
    if isinstance(table, Table) and compound and topic.strip("/") in ("", "CD", "CD/events"):
        return _prophesee(file, table, info, backend)
    groups: list[str] = ["CD/events"] if compound else []
    groups += [
        name for name, item in (("/", file), *_objects_below(file)) if _holds_events(item, info) and name not in groups
    ]
    if not groups:
        raise ValueError("an HDF5 file without events: no CD/events, no x, y, t, p, no N x 4 events")
    info.topics = tuple(groups)
    if topic and topic not in groups:
        raise RecordingError(f"{info.path}: no events in '{topic}'; they are in {', '.join(groups)}")
    name = topic or groups[0]
    if len(groups) > 1 and not topic:
        info.warn(f"events in {', '.join(groups)}: these are of {name}")
    found = member(file, name, info)
    if isinstance(found, Table):
        return _records(found, info) if found.dtype.names else _table(found, info)
    return _columns(file, found, info)


def _objects_below(group: h5py.Group, prefix: str = "", met: set[Any] | None = None) -> Iterator[tuple[str, Any]]:
    """Yields all objects that can be read, by their paths; those whose headers are damaged or cut off are left out."""
    met = set() if met is None else met
    for name in _names(group):
        try:
            link = group.id.links.get_info(name.encode())
            if link.type != h5py.h5l.TYPE_HARD or link.u in met or len(met) >= _MOST_OBJECTS:
                continue
            met.add(link.u)
            item = group[name]
        except (KeyError, RuntimeError, OSError, ValueError, TypeError, UnicodeError):
            continue
        yield prefix + name, item
        if isinstance(item, h5py.Group) and prefix.count("/") < _DEEPEST:
            yield from _objects_below(item, f"{prefix}{name}/", met)


def _names(group: h5py.Group) -> list[str]:
    try:
        return list(group.keys())
    except (RuntimeError, OSError, ValueError):
        return []


def _holds_events(item: Any, info: RecordingInfo) -> bool:
    if isinstance(item, h5py.Dataset):
        if item.dtype.names:
            return item.ndim == 1 and all(_names_of_columns(item.dtype.names).values())
        return item.ndim == 2 and item.shape[1] == 4 and item.name.rpartition("/")[2] == "events"
    if not isinstance(item, h5py.Group):
        return False
    names = _names_of_columns(_names(item))
    return all(names.values()) and all(isinstance(member(item, n, info), Table) for n in names.values())


def _names_of_columns(there: Any) -> dict[str, str]:
    """Finds the names of t, x, y and p among those that are there; empty where one is missing."""
    return {column: next((n for n in names if n in there), "") for column, names in NAMES.items()}


# -- Prophesee ---------------------------------------------------------------------------------------------------------


def _prophesee(file: h5py.File, table: Table, info: RecordingInfo, backend: str) -> Layout:
    names = set(table.dtype.names or ())
    if not {"x", "y", "t", "p"} <= names or table.ndim != 1:
        raise RecordingError(f"{info.path}: CD/events has the fields {', '.join(sorted(names))}, not x, y, p, t")
    filters = table.filters
    chunk = table.chunks[0] if table.chunks else 0
    if filters and FILTER in filters and (filters != [FILTER] or not 0 < chunk <= _MAX_CHUNK):
        raise RecordingError(f"{info.path}: CD/events has ECF among other filters or in chunks of {chunk} events")
    if backend == "auto":
        backend = "warp" if table.shape[0] > 1 << 20 else "numpy"

    def whole(a: int, b: int) -> Events:
        if FILTER in filters:
            return _ecf_chunk(table, a, b, backend)
        rows = table[a:b]
        return _events(rows["t"], rows["x"], rows["y"], rows["p"], 1000)

    def time_at(i: int) -> int:
        a = i - i % chunk if FILTER in filters else i
        return int(whole(a, min(a + (chunk or 1), table.shape[0])).t[i - a])

    def size() -> tuple[int, int, str]:
        width, height = _geometry(file)
        return (width, height, "header") if width and height else (0, 0, "")

    def triggers() -> Triggers:
        edges = member(file, "EXT_TRIGGER/events", info)
        if not isinstance(edges, Table) or not edges.size or edges.size > _MAX_CHUNK:
            return Triggers()
        parts = [(0, len(edges))]
        if info.truncated:
            parts = rows_there(edges, info.size_bytes, 0, len(edges))
            if lost := len(edges) - sum(b - a for a, b in parts):
                info.warn(f"{lost} of {len(edges)} triggers lie behind the cut")
        rows = np.concatenate([edges[0:0], *(edges[a:b] for a, b in parts)])
        return Triggers(
            rows["t"].astype(np.int64) * 1000, rows["id"].astype(np.uint8), (rows["p"] > 0).astype(np.uint8)
        )

    def read_cut(a: int, data: bytes) -> Events:
        if table.id.get_chunk_info_by_coord((a,)).filter_mask & 1:
            return _rows(table, data)
        t, x, y, p = ecf.decode_cut(data)
        return Events(t * 1000, x, y, p)

    _check_claim(info, table.shape[0], [table])
    if FILTER not in filters:
        return Layout("compound", table.shape[0], [table], whole, time_at, size, triggers)
    return Layout("ecf", table.shape[0], [table], whole, time_at, size, triggers, chunk, read_cut)


def _rows(table: Table, data: bytes) -> Events:
    rows = np.frombuffer(data, table.dtype, len(data) // table.dtype.itemsize)
    return _events(rows["t"], rows["x"], rows["y"], rows["p"], 1000)


def _ecf_chunk(table: Table, a: int, b: int, backend: str) -> Events:
    mask, data = table.id.read_direct_chunk((a,))
    if mask & 1:
        return _rows(table, data)[: b - a]
    try:
        t, x, y, p = ecf.decode(data, backend)
    except DamagedError as error:
        raise ValueError(str(error)) from None
    return Events(t * 1000, x, y, p)[: b - a]


def _records(table: Table, info: RecordingInfo) -> Layout:
    """Describes a dataset of records with named fields, one per event."""
    names = _names_of_columns(table.dtype.names)
    times = _Times(table, names["t"], info)

    def read(a: int, b: int) -> Events:
        rows = table[a:b]
        return _events(times.in_ns(rows[names["t"]]), rows[names["x"]], rows[names["y"]], rows[names["p"]], 1)

    _check_claim(info, table.shape[0], [table])
    count = table.shape[0]
    return Layout("records", count, [table], read, lambda i: int(read(i, i + 1).t[0]), lambda: (0, 0, ""))


class _Times:
    """Converts times of any type to ns: with fractions s, whole us; ns where the name says it or us cannot be."""

    def __init__(self, table: Table, name: str, info: RecordingInfo, offset_us: int = 0) -> None:
        self._offset_us = offset_us
        n = min(table.shape[0], LOOK)
        if info.truncated:
            parts = rows_there(table, info.size_bytes, 0, n)
            n = parts[0][1] if parts and parts[0][0] == 0 else 0
        values = table[:n][name] if table.dtype.names else table[:n]
        self._seconds = values.dtype.kind == "f" and not is_whole(values)
        most = float(np.abs(values.astype(np.float64)).max(initial=0.0))
        self._unit = 1 if name == "t_ns" or most >= NS_FROM else 1000

    def in_ns(self, values: np.ndarray) -> np.ndarray:
        if self._seconds:
            return seconds_in_ns(values)
        if values.dtype.kind == "f" and (values != np.floor(values)).any():
            raise ValueError("its times begin with whole us and go on with fractions")
        return (values.astype(np.int64) + self._offset_us) * self._unit


# -- columns -----------------------------------------------------------------------------------------------------------


def _columns(file: h5py.File, group: h5py.Group, info: RecordingInfo) -> Layout:
    with contextlib.suppress(ImportError):
        import hdf5plugin  # noqa: F401 (registers the compressions that DSEC and TUM-VIE use)
    names = _names_of_columns(_names(group))
    found = [member(group, names[c], info) for c in "txyp"]
    t, x, y, p = tables = [table for table in found if isinstance(table, Table)]
    for name, table in zip("txyp", tables):
        if table.ndim != 1:
            raise RecordingError(f"{info.path}: {names[name]} in {group.name} has {table.ndim} axes, not one")
    offset_us = 0
    offset = member(file, "t_offset", info)
    shifted = "t_offset" in _names(file)
    if isinstance(offset, Table) and offset.size == 1 and _is_there(offset, info):
        offset_us = int(np.asarray(offset[()]).reshape(-1)[0])
    elif shifted:
        info.warn("t_offset cannot be read: times count from the start of the file's own clock")
    indexed = any({"ms_to_idx", "ms_map_idx"} & set(_names(g)) for g in (file, group))
    whole_file = group.name == "/"
    name = ("dsec" if shifted else "eds" if whole_file else "tum-vie") if indexed else "columns"
    lengths = {name: table.shape[0] for name, table in zip("txyp", tables)}
    count = min(lengths.values())
    if lost := max(lengths.values()) - count:
        told = ", ".join(f"{names[name]} {length}" for name, length in lengths.items())
        info.warn(f"columns of different lengths ({told}): {lost} rows that not all of them have are left out")
    _check_claim(info, count, tables)

    times = _Times(t, names["t"], info, offset_us).in_ns

    def read(a: int, b: int) -> Events:
        return _events(times(t[a:b]), x[a:b], y[a:b], p[a:b], 1)

    def size() -> tuple[int, int, str]:
        if all(stated := _geometry(file)):
            return (*stated, "header")
        given = file.attrs.get("sensor_resolution")
        calibrated = member(group, "calib/resolution", info)
        if given is None and isinstance(calibrated, Table) and calibrated.size == 2:
            given = calibrated[()]
        if given is None:
            found = [member(group, side, info) for side in ("height", "width")]
            sides = [s for s in found if isinstance(s, Table) and s.size == 1 and s.dtype.kind in "iu"]
            if len(sides) == 2:
                given = [np.asarray(side[()]).reshape(-1)[0] for side in sides]
        if given is not None and np.shape(given) == (2,) and all(0 < v < 65536 for v in given):
            height, width = sorted(int(v) for v in given)
            return width, height, "header"
        known = {"dsec": (640, 480), "eds": (640, 480), "tum-vie": (1280, 720)}.get(name)
        n = _rows_for_size([x, y], info)
        fits = known and (not n or (int(x[:n].max()) < known[0] and int(y[:n].max()) < known[1]))
        return (*known, "sensor") if known and fits else (0, 0, "")

    return Layout(name, count, tables, read, lambda i: int(times(t[i : i + 1])[0]), size)


def _geometry(file: Any) -> tuple[int, int]:
    """Reads width and height [px] of the attribute `geometry`, as 640x480; 0, 0 without one."""
    text = file.attrs.get("geometry", b"")
    text = text.decode(errors="replace") if isinstance(text, bytes) else str(text)
    found = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text)
    return (int(found[1]), int(found[2])) if found else (0, 0)


def _rows_for_size(tables: list[Table], info: RecordingInfo) -> int:
    """Counts the first rows that are read for the sensor's size."""
    n = min(1 << 20, *(table.shape[0] for table in tables))
    for table in tables if info.truncated else []:
        parts = rows_there(table, info.size_bytes, 0, n)
        n = parts[0][1] if parts and parts[0][0] == 0 else 0
    return n


def _is_there(table: Table, info: RecordingInfo) -> bool:
    begin = table.id.get_offset()
    return not info.truncated or (begin is not None and begin + table.id.get_storage_size() <= info.size_bytes)


def _table(table: Table, info: RecordingInfo) -> Layout:
    """Describes a table: MVSEC has rows of x, y, t [s], p (-1 or 1) as float64; v2e of t [us], x, y, p (0 or 1) as
    uint32."""
    whole_numbers = table.dtype.kind in "iu"
    if whole_numbers:
        info.warn("rows of whole numbers: taken as t in us, x, y, p")

    def read(a: int, b: int) -> Events:
        if whole_numbers:
            t, x, y, p = table[a:b].astype(np.int64).T
            if len(t) and int(np.abs(t).max()) > 1 << 52:
                raise ValueError("values that are no events")
            return _events(t, x, y, p, 1000)
        rows = table[a:b].astype(np.float64)
        if not np.isfinite(rows).all() or (np.abs(rows) > 1e10).any():
            raise ValueError("values that are no events")
        x, y, t, p = rows.T
        return _events(seconds_in_ns(t), x.astype(np.int64), y.astype(np.int64), p, 1)

    def size() -> tuple[int, int, str]:
        n = _rows_for_size([table], info)
        fits = "davis" in table.name and n and (table[:n, :2].max(0) < (346, 260)).all()
        return (346, 260, "sensor") if fits else (0, 0, "")

    _check_claim(info, table.shape[0], [table])
    name = "v2e" if whole_numbers else "mvsec"
    return Layout(name, table.shape[0], [table], read, lambda i: int(read(i, i + 1).t[0]), size)


def _check_claim(info: RecordingInfo, count: int, tables: list[Table]) -> None:
    """Raises ValueError for more events than any compression puts into the stored bytes.

    A damaged number must not keep a reader busy for ever.
    """
    stored = info.size_bytes if info.truncated else sum(table.id.get_storage_size() for table in tables)
    if count > _MOST_EVENTS_A_BYTE * stored:
        raise ValueError(f"damaged: {count} events in {stored} bytes")
    if not info.truncated:
        Allowance(info.size_bytes).check(sum(table.bytes for table in tables))


def _events(t: Any, x: Any, y: Any, p: Any, unit: int) -> Events:
    """Converts columns of any number type to events; what does not fit uint16 becomes 65535, outside of every
    sensor."""
    return Events(t.astype(np.int64) * unit, _as_uint16(x), _as_uint16(y), (np.asarray(p) > 0).astype(np.uint8))


def _as_uint16(values: Any) -> np.ndarray:
    """Converts numbers to uint16, 65535 for those outside of it.

    Not by np.where, for 65535 need not fit the type that they have.
    """
    given = np.asarray(values)
    outside = (given < 0) | (given > 65535)
    found = np.where(outside, 0, given).astype(np.uint16)
    found[outside] = 65535
    return found
