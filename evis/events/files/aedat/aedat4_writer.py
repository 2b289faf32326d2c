"""Writes AEDAT 4 as DV does: events, frames, IMU samples and triggers in streams 0 to 3, and the table of packets."""

from __future__ import annotations

import os
import struct
from xml.sax.saxutils import escape

import numpy as np

from evis.events.arrays import STANDARD_GRAVITY, Events, Frame, Imu, Triggers
from evis.events.files.aedat.aedat4 import MAGIC
from evis.events.files.aedat.aedat4_packets import EVENT, SOURCES
from evis.events.files.aedat.flat_builder import single_table, vector_of_structs, vector_of_tables
from evis.events.files.file_writer import FileWriter, check_size
from evis.events.files.reading.block_recording import split_aside
from evis.events.recording import RecordingError

COMPRESSIONS = {"none": 0, "lz4": 1, "zstd": 3}
_STREAMS = (("events", "EVTS"), ("frames", "FRME"), ("imu", "IMUS"), ("triggers", "TRIG"))
_PACKET = 1 << 14
"""Events of a packet at most: what a reader needs in memory at once."""
_TABLE = np.dtype([("table", "<i4"), ("stream", "<i4"), ("size", "<i4"), ("pad", "<i4"),
                   ("at", "<i8"), ("n", "<i8"), ("first", "<i8"), ("last", "<i8")])  # fmt: skip
_TABLE_FIELDS = [16, 4, 24, 32, 40]
_IMU = np.dtype([("table", "<i4"), ("temperature", "<f4"), ("t", "<i8"), ("a", "<f4", 3), ("w", "<f4", 3)])
_IMU_FIELDS = [8, 4, 16, 20, 24, 28, 32, 36]
_TRIGGER = np.dtype([("table", "<i4"), ("source", "<i4"), ("t", "<i8")])
_TRIGGER_FIELDS = [8, 4]
_CODES = {v: k for k, v in reversed(SOURCES.items())}


class Aedat4Writer(FileWriter):
    """Writes .aedat4. Times are rounded down to whole us; coordinates go up to 32767."""

    keeps = frozenset({"triggers", "imu", "frames"})

    def __init__(self, path: str | os.PathLike[str], width: int, height: int, compression: str) -> None:
        super().__init__(path)
        self._squeeze = _squeezer(compression)
        self._table: list[tuple[int, ...]] = []
        text = _description(width, height, compression.upper()).encode() + b"\0"
        header, places = single_table(b"IOHE", [("i", COMPRESSIONS[compression]), ("q", -1)], text)
        self._position_at = len(MAGIC) + places[1]
        self._file = self.partial.open("wb")
        self._file.write(MAGIC + header)

    def write(self, events: Events) -> None:
        if len(events) and max(int(events.x.max()), int(events.y.max())) > 32767:
            raise RecordingError(f"{self.path}: AEDAT 4 holds coordinates up to 32767")
        waiting = events
        for first in range(0, len(events), _PACKET):
            part = events[first : first + _PACKET]
            # who reads a part of the file stops at the first event behind it: all else goes before that
            before, waiting = split_aside(waiting, int(part.t.max()))
            self._aside(before)
            rows = np.zeros(len(part), EVENT)
            rows["t"], rows["x"], rows["y"], rows["on"] = part.t // 1000, part.x, part.y, part.p
            self._packet(0, vector_of_structs(b"EVTS", rows), rows["t"])
        self._aside(waiting)

    def _aside(self, events: Events) -> None:
        """Writes frames, inertial samples and triggers."""
        for frame in events.frames:
            self._frame(frame)
        self._imu(events.imu)
        self._triggers(events.triggers)

    def _packet(self, stream: int, data: bytes, t_us: np.ndarray) -> None:
        data = self._squeeze(data)
        at = self._file.tell() + 8
        self._file.write(struct.pack("<ii", stream, len(data)) + data)
        self._table.append((0, stream, len(data), 0, at, len(t_us), int(t_us.min()), int(t_us.max())))

    def _frame(self, frame: Frame) -> None:
        pixels = frame.pixels if frame.pixels.ndim == 2 else frame.pixels[..., ::-1]  # RGB to BGR
        deep, colour = pixels.dtype.itemsize == 2, pixels.ndim == 3
        # the format's own time of a frame is the middle of its exposure
        middle = frame.middle_ns
        times = (middle, frame.t_ns, frame.end_ns, frame.exposure_start_ns, frame.exposure_end_ns)
        fields: list[tuple[str, float]] = [("q", t // 1000) for t in times]
        fields += [("b", (2 if deep else 0) | (16 if colour else 0)), ("h", pixels.shape[1]), ("h", pixels.shape[0])]
        fields += [("h", frame.x0), ("h", frame.y0)]
        data, _ = single_table(b"FRME", fields, np.ascontiguousarray(pixels).tobytes(), 8)
        self._packet(1, data, np.array([middle // 1000]))

    def _imu(self, imu: Imu) -> None:
        if len(imu):
            rows = np.zeros(len(imu), _IMU)
            rows["t"], rows["temperature"] = imu.t // 1000, imu.temperature
            rows["a"], rows["w"] = imu.acceleration / STANDARD_GRAVITY, np.degrees(imu.angular_velocity)
            self._packet(2, vector_of_tables(b"IMUS", rows, _IMU_FIELDS), rows["t"])

    def _triggers(self, edges: Triggers) -> None:
        if len(edges):
            codes = [_CODES.get((int(i), int(v))) for i, v in zip(edges.id, edges.value)]
            # channels of other sensors become the external signal, which is all the format has
            rows = np.zeros(len(edges), _TRIGGER)
            rows["t"] = edges.t // 1000
            rows["source"] = [(1 if v else 2) if c is None else c for c, v in zip(codes, edges.value)]
            self._packet(3, vector_of_tables(b"TRIG", rows, _TRIGGER_FIELDS), rows["t"])

    def _finish(self) -> None:
        position = self._file.tell()
        rows = np.array(self._table, _TABLE) if self._table else np.empty(0, _TABLE)
        self._file.write(self._squeeze(vector_of_tables(b"FTAB", rows, _TABLE_FIELDS)))
        self._file.seek(self._position_at)
        self._file.write(struct.pack("<q", position))
        self._file.close()


def _squeezer(compression: str):  # type: ignore[no-untyped-def]
    if compression == "none":
        return bytes
    if compression == "zstd":
        import zstandard

        return zstandard.ZstdCompressor(level=1).compress
    import lz4.frame

    return lz4.frame.compress


def _description(width: int, height: int, compression: str) -> str:
    """Writes the header's XML in the form of DV's recorder."""
    nodes = []
    for i, (name, kind) in enumerate(_STREAMS):
        size = (
            f'<attr key="sizeX" type="int">{width}</attr><attr key="sizeY" type="int">{height}</attr>' if i < 2 else ""
        )
        nodes.append(
            f'<node name="{i}" path="/mainloop/Recorder/outInfo/{i}/">'
            f'<attr key="compression" type="string">{escape(compression)}</attr>'
            f'<attr key="originalModuleName" type="string">evis</attr>'
            f'<attr key="originalOutputName" type="string">{name}</attr>'
            f'<attr key="typeDescription" type="string">{name}</attr>'
            f'<attr key="typeIdentifier" type="string">{kind}</attr>'
            f'<node name="info" path="/mainloop/Recorder/outInfo/{i}/info/">{size}'
            f'<attr key="source" type="string">EVIS</attr><attr key="tsOffset" type="long">0</attr></node></node>'
        )
    return f'<dv version="2.0"><node name="outInfo" path="/mainloop/Recorder/outInfo/">{"".join(nodes)}</node></dv>'


def create(path: str | os.PathLike[str], width: int, height: int, encoding: str = "") -> Aedat4Writer:
    """Returns an AEDAT 4 writer. encoding: the compression, zstd (default), lz4 or none. Raises RecordingError."""
    encoding = encoding or "zstd"
    if encoding not in COMPRESSIONS:
        raise RecordingError(f"{path}: cannot write the compression '{encoding}'; known are {', '.join(COMPRESSIONS)}")
    check_size(path, "AEDAT 4", width, height, 32767)
    return Aedat4Writer(path, width, height, encoding)
