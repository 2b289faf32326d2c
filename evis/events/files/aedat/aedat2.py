"""Reads AEDAT 2.0 of jAER: `#` lines, then big-endian records of a 32-bit address and a 32-bit time in us.

AEDAT 1.0 is the same with addresses of 16 bits, from DVS128 cameras.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from evis.events.arrays import Events, Triggers
from evis.events.files.aedat import FAMILY
from evis.events.files.aedat.aedat2_davis import DavisSamples
from evis.events.files.reading.block_recording import take_size
from evis.events.files.reading.header_lines import is_cut_line
from evis.events.files.reading.record_file import RecordFile
from evis.events.recording import HEAD, OpenOptions, RecordingInfo

NAME = FAMILY

DAVIS_SENSORS = ((240, 180), (346, 260), (640, 480))
_CHIPS = {"davis240": (240, 180), "davis346": (346, 260), "davis640": (640, 480), "davis208": (208, 192),
          "dvxplorer": (640, 480), "dvs640": (640, 480), "dvs128": (128, 128), "tmpdiff128": (128, 128)}  # fmt: skip
# a record can begin with the byte of `#`, but is hardly a line of text
_LINE = re.compile(rb"#[\t\x20-\xff]*\r?\n")
_RECORD = np.dtype([("address", ">u4"), ("t", ">i4")])
_SHORT = np.dtype([("address", ">u2"), ("t", ">i4")])


def matches(head: bytes, path: Path, name: str) -> bool:
    """Tells whether a file begins with the signature; files without a version are not told apart from others."""
    return head.startswith((b"#!AER-DAT2", b"#!AER-DAT1"))


class Aedat2Recording(RecordFile):
    """Reads an AEDAT 2.0 file of a DVS128 or a DAVIS, or one of version 1.0.

    DVS128 address: polarity OFF bit 0, x bits 1-7 counted from the right (as jAER shows it), y bits 8-14, external
    input bit 15. DAVIS: bit 31 APS or IMU; y bits 22-30, x bits 12-21, polarity bit 11, external input bit 10.
    """

    counter_bits = 32
    own_packets = True

    def __init__(self, path: Path, options: OpenOptions) -> None:
        lines, start, cut = read_header(path)
        with path.open("rb") as file:
            old = file.read(10) == b"#!AER-DAT1"
        self.record = _SHORT if old else _RECORD
        chip = "DVS128" if old else next((v for k, v in lines.items() if k.lower() == "aechip"), "").rpartition(".")[2]
        self.info = RecordingInfo(
            str(path), "aedat1" if old else "aedat2", "", 0, 0, "header", path.stat().st_size, sensor=chip, header=lines
        )
        if cut:
            self.info.truncated = True
            self.info.warn("cut inside the header: there is no event")
        self._open_records(path, start)
        try:
            self._find_sensor(chip.lower(), options)
        except BaseException:
            self.close()
            raise
        super().__init__()

    def _find_sensor(self, chip: str, options: OpenOptions) -> None:
        info = self.info
        size = next((s for name, s in _CHIPS.items() if name in chip), None)
        if size is None and not chip:
            addresses = self._records(0, min(self._total, 1 << 16))["address"] if self._total else np.empty(0, "u4")
            size = (128, 128) if len(addresses) and int(addresses.max()) < 1 << 16 else None
        self._dvs128 = size == (128, 128)
        info.encoding = "dvs128" if self._dvs128 else "davis"
        if take_size(info, options):
            return
        if size:
            (info.width, info.height), info.geometry_from = size, "header" if chip else "sensor"
        else:
            self._size_from_events(DAVIS_SENSORS)

    def _counter(self, records: np.ndarray) -> np.ndarray:
        return records["t"].astype(np.int64)

    def _load_at(self, first: int, before: tuple[int, int] | None) -> Iterator[Events]:
        self._samples = DavisSamples()
        yield from super()._load_at(first, before)
        last = Events.empty()
        self._samples.finish(last)
        yield last

    def _events(self, records: np.ndarray, t_us: np.ndarray) -> Events:
        address, t = records["address"].astype(np.int64), t_us * 1000
        if self._dvs128:
            return _dvs128(address, t)
        aps = address >> 31 == 1
        external = ~aps & (address >> 10 & 1 == 1)
        plain = ~aps & ~external
        a = address[plain]
        events = Events(
            t[plain],
            (a >> 12 & 0x3FF).astype(np.uint16),
            (a >> 22 & 0x1FF).astype(np.uint16),
            (a >> 11 & 1).astype(np.uint8),
        )
        events.triggers = _triggers(t[external], address[external] >> 11 & 1)
        if aps.any():
            self._samples.add(address[aps], t[aps], events)
            self.count("frames_damaged", self._samples.take_damaged())
        return events


def _dvs128(address: np.ndarray, t: np.ndarray) -> Events:
    external = address >> 15 & 1 == 1
    a = address[~external]
    x, y, p = 127 - (a >> 1 & 127), a >> 8 & 127, 1 - (a & 1)
    events = Events(t[~external], x.astype(np.uint16), y.astype(np.uint16), p.astype(np.uint8))
    events.triggers = _triggers(t[external], np.ones(np.count_nonzero(external), np.int64))
    return events


def _triggers(t: np.ndarray, value: np.ndarray) -> Triggers:
    return Triggers(t, np.zeros(len(t), np.uint8), value.astype(np.uint8)) if len(t) else Triggers()


def read_header(path: Path) -> tuple[dict[str, str], int, bool]:
    """Reads the `# Key: value` lines, the position of the first record, behind the last line that begins with `#`, and
    whether the file is cut inside such a line.
    """
    header: dict[str, str] = {}
    position = 0
    with path.open("rb") as file:
        while position < 4 << 20:
            line = file.readline(HEAD)
            if is_cut_line(line, b"#") and not file.read(1):
                return header, position + len(line), True
            if not _LINE.fullmatch(line):
                break
            position += len(line)
            if line.startswith(b"#End Of ASCII Header"):
                break
            found = re.fullmatch(r"#\s*([A-Za-z][\w ]{0,40}):\s+(.*)", line.decode("latin-1").strip())
            if found:
                header.setdefault(found[1], found[2])
    return header, position, False


def open_file(path: Path, options: OpenOptions) -> Aedat2Recording:
    """Opens an AEDAT 2.0 file. Raises RecordingError."""
    return Aedat2Recording(path, options)
