"""Reads the packets of AEDAT 4: EVTS (events), FRME (a frame), IMUS (inertial samples), TRIG (triggers)."""

from __future__ import annotations

import numpy as np

from evis.events.arrays import STANDARD_GRAVITY, Events, Frame, Imu, Triggers
from evis.events.files.aedat.flatbuffer import Rows, Table, columns
from evis.events.files.reading.decompress import DamagedError

KINDS = (b"EVTS", b"FRME", b"IMUS", b"TRIG")
EVENT = np.dtype(
    {"names": ["t", "x", "y", "on"], "formats": ["<i8", "<i2", "<i2", "u1"], "offsets": [0, 8, 10, 12], "itemsize": 16}
)
SOURCES = {1: (0, 1), 2: (0, 0), 3: (0, 1), 4: (1, 1), 5: (1, 0), 6: (2, 1), 7: (2, 0), 8: (3, 1), 9: (3, 0), 0: (4, 1)}
"""Trigger source -> (id, value). ids: 0 external signal (3 = pulse), 1 signal generator, 2 frame readout, 3 exposure,
4 reset of the time."""

_BY_SOURCE = np.array([SOURCES.get(i, (0, -1)) for i in range(256)], np.int8).T
_IMU = ((0, "q"), *((i, "f") for i in range(1, 8)))
_EDGE = ((0, "q"), (1, "b"))
_FIRST, _ROOM = 1 << 17, 1 << 13
"""Events that are put together first, so that a small file is one block, and later: memory of this size goes round,
where larger arrays come from the system page by page."""
_FRAMES = 32
_RGB = {1: [0], 3: [2, 1, 0], 4: [2, 1, 0]}


class Packets:
    """Collects the contents of uncompressed packets in arrays; `full` when another one like the last might not fit."""

    def __init__(self) -> None:
        self._room = _FIRST
        self._begin()

    def _begin(self) -> None:
        self._events = Events.empty()
        self._n = self._last = 0
        self._imu: list[Rows] = []
        self._edges: list[Rows] = []
        self._frames: list[Frame] = []
        self.empty = True
        self.full = False

    def add(self, data: bytes, cut: bool = False) -> None:
        """Adds one packet. cut: it may end early. Raises DamagedError, and then holds what it held before."""
        kind = data[8:12]
        if kind not in KINDS:
            raise DamagedError("it holds nothing that is known")
        root = Table.root(data, kind)
        if kind == b"EVTS":
            self._add_events(root.vector(0, EVENT, cut))
        elif kind == b"FRME":
            self._frames.append(_frame(root))
            self.full |= len(self._frames) >= _FRAMES
        elif kind == b"IMUS":
            self._imu.append(root.rows(0, _IMU, cut))
        else:
            self._edges.append(root.rows(0, _EDGE, cut))
        self.empty = False

    def _add_events(self, raw: np.ndarray) -> None:
        """Adds events at once, while the unpacked bytes are in the cache."""
        first, last = self._n, self._n + len(raw)
        if last > len(self._events):
            before, room = self._events[:first], max(self._room, last)
            t, x, y, p = (np.empty(room, d) for d in (np.int64, np.uint16, np.uint16, np.uint8))
            self._events = Events(t, x, y, p)
            self._put(0, before.t, before.x, before.y, before.p)
        np.multiply(raw["t"], 1000, out=self._events.t[first:last])
        self._put(first, None, raw["x"], raw["y"], raw["on"] != 0)
        self._n = last
        self.full |= last + len(raw) > len(self._events)

    def _put(self, first: int, t: np.ndarray | None, x: np.ndarray, y: np.ndarray, p: np.ndarray) -> None:
        last = first + len(x)
        events = self._events
        events.x[first:last], events.y[first:last], events.p[first:last] = x, y, p
        if t is not None:
            events.t[first:last] = t

    def take(self) -> Events:
        """Returns, and removes, what the packets hold, each kind in the order of the packets."""
        events = self._events[: self._n]
        if self._imu:
            events.imu = _imu(self._imu)
        if self._edges:
            events.triggers = _triggers(self._edges)
        events.frames = self._frames
        self._room = _ROOM
        self._begin()
        return events


def _frame(frame: Table) -> Frame:
    t, start, end, exposed, closed = (frame.integer(i, "q") * 1000 for i in range(5))
    code, width, height = frame.integer(5, "b"), frame.integer(6, "h"), frame.integer(7, "h")
    # the format is OpenCV's: bits 0-2 the type of number, above that the channels - 1
    dtype, channels = {0: "u1", 2: "<u2"}.get(code & 7), (code >> 3) + 1
    if dtype is None or channels not in _RGB or width <= 0 or height <= 0:
        raise DamagedError(f"a frame of {width}x{height} in the unknown format {code}")
    values = frame.vector(10, np.dtype(np.uint8))
    if len(values) != width * height * channels * np.dtype(dtype).itemsize:
        raise DamagedError(f"a frame of {width}x{height} with {len(values)} bytes")
    pixels = values.view(dtype).reshape(height, width, channels)[..., _RGB[channels]]
    pixels = pixels[..., 0] if channels == 1 else pixels
    # newer writers tell the exposure alone; the readout then has no length of its own
    exposed = exposed or t
    closed = closed or exposed + frame.integer(11, "q") * 1000
    start, end = start or min(t, exposed), end or max(t, closed)
    return Frame(start, pixels, exposed, closed, frame.integer(8, "h"), frame.integer(9, "h"), end)


def _imu(parts: list[Rows]) -> Imu:
    t, temperature, *axes = columns(parts, _IMU)
    values = np.stack(axes, 1).astype(np.float64)
    return Imu(t * 1000, values[:, :3] * STANDARD_GRAVITY, np.radians(values[:, 3:]), temperature.astype(np.float64))


def _triggers(parts: list[Rows]) -> Triggers:
    t, source = columns(parts, _EDGE)
    ids, values = _BY_SOURCE[:, source.astype(np.uint8)]
    known = values >= 0
    return Triggers(t[known] * 1000, ids[known].astype(np.uint8), values[known].astype(np.uint8))
