"""The packets of AEDAT 4: EVTS (events), FRME (a frame), IMUS (inertial samples), TRIG (triggers)."""

from __future__ import annotations

import numpy as np

from evis.streams.events import Events, Frame, Imu, Triggers
from evis.streams.files.flat import Table
from evis.streams.files.inflate import DamagedError

KINDS = (b"EVTS", b"FRME", b"IMUS", b"TRIG")
EVENT = np.dtype(
    {"names": ["t", "x", "y", "on"], "formats": ["<i8", "<i2", "<i2", "u1"], "offsets": [0, 8, 10, 12], "itemsize": 16}
)
GRAVITY = 9.80665
"""[m/s^2]"""

SOURCES = {1: (0, 1), 2: (0, 0), 3: (0, 1), 4: (1, 1), 5: (1, 0), 6: (2, 1), 7: (2, 0), 8: (3, 1), 9: (3, 0), 0: (4, 1)}
"""Trigger source -> (id, value). ids: 0 external signal (3 = pulse), 1 signal generator, 2 frame readout, 3 exposure,
4 reset of the time."""

_BY_SOURCE = np.array([SOURCES.get(i, (0, -1)) for i in range(256)], np.int8).T
_RGB = {1: [0], 3: [2, 1, 0], 4: [2, 1, 0]}


def unpack(data: bytes, cut: bool = False) -> Events:
    """One uncompressed packet. cut: it may end early. Raises DamagedError."""
    if data[8:12] not in KINDS:
        raise DamagedError("it holds nothing that is known")
    root = Table.root(data, data[8:12])
    if data[8:12] == b"EVTS":
        raw = root.vector(0, EVENT, cut)
        return Events(
            raw["t"] * 1000, raw["x"].astype(np.uint16), raw["y"].astype(np.uint16), (raw["on"] != 0).view(np.uint8)
        )
    events = Events.empty()
    if data[8:12] == b"FRME":
        events.frames.append(_frame(root))
    elif data[8:12] == b"IMUS":
        events.imu = _imu(root, cut)
    else:
        events.triggers = _triggers(root, cut)
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
    return Frame(start or t, pixels, exposed or t, closed or t, frame.integer(8, "h"), frame.integer(9, "h"), end or t)


def _imu(root: Table, cut: bool) -> Imu:
    t, temperature, *axes = root.columns(0, {0: "q", **dict.fromkeys(range(1, 8), "f")}, cut)
    values = np.stack(axes, 1).astype(np.float64)
    return Imu(t * 1000, values[:, :3] * GRAVITY, np.radians(values[:, 3:]), temperature.astype(np.float64))


def _triggers(root: Table, cut: bool) -> Triggers:
    t, source = root.columns(0, {0: "q", 1: "b"}, cut)
    ids, values = _BY_SOURCE[:, source.view(np.uint8)]
    known = values >= 0
    return Triggers(t[known] * 1000, ids[known].astype(np.uint8), values[known].astype(np.uint8))
