"""Reads the header of a Prophesee RAW file: lines `% key value`, and what they say of encoding and sensor."""

from __future__ import annotations

import re
from typing import BinaryIO

SYSTEMS = {
    0x15: ("Gen3", 640, 480),
    0x1C: ("Gen3.1 CCAM3", 640, 480),
    0x28: ("EVK3 Gen3.1", 640, 480),
    0x30: ("EVK3 Gen4.1", 1280, 720),
    0x31: ("EVK3 IMX636", 1280, 720),
    0x32: ("EVK2 IMX636", 1280, 720),
    0x35: ("IMX646", 1280, 720),
    0x3B: ("GenX320", 320, 320),
    0x40: ("GenX320", 320, 320),
}
"""system_ID of the header -> name, width, height, for headers without a geometry."""
_FAMILIES = (
    (r"genx320|\bgen ?x", 320, 320),
    (r"imx636|imx646|gen4", 1280, 720),
    (r"gen3", 640, 480),
)
"""Names of plug-in and sensor -> width, height, for headers without geometry and system_ID."""

_EVT = {"2.0": "evt2", "2.1": "evt21", "3.0": "evt3", "4.0": "evt4"}
KEYS = {
    "evt", "format", "geometry", "system_id", "serial_number", "sensor_generation", "generation", "sensor_name",
    "plugin_name",
}  # fmt: skip
_MAX_HEADER = 1 << 20
_MAX_LINE = 4096
_PRINTABLE = re.compile(r"[^\x00-\x08\x0a-\x1f\x7f-\x9f]*")


def read_header(file: BinaryIO) -> tuple[dict[str, str], int]:
    """Reads the header: keys in lower case, and the position of the first word.

    The header ends with `% end`, or before the first line that does not start with `% ` and is not `%` alone (old
    files).
    """
    header: dict[str, str] = {}
    position = 0
    while position < _MAX_HEADER:
        line = file.readline(_MAX_LINE)
        if not line.startswith((b"% ", b"%\n", b"%\r\n")) or not line.endswith(b"\n"):
            break
        try:
            text = line.rstrip(b"\r\n").decode()
        except UnicodeDecodeError:
            break
        if not _PRINTABLE.fullmatch(text):
            break
        position += len(line)
        key, value = (*re.split(r"[ \t]+", text[1:].strip(), maxsplit=1), "")[:2]
        if key.lower() == "end" and not value:
            break
        if key:
            header[key.lower()] = value
    file.seek(position)
    return header, position


def encoding_of(header: dict[str, str]) -> str:
    """Returns `evt3`, ... from `format EVT3;...` or `evt 3.0`; empty where the header does not say."""
    name = header.get("format", "").partition(";")[0].strip().lower().replace(".", "")
    name = name or _EVT.get(header.get("evt", ""), "evt" + header["evt"] if header.get("evt") else "")
    order = header.get("endianness", "") or value_in_format(header, "endianness")
    return "evt21_legacy" if name == "evt21" and order == "legacy" else name


def value_in_format(header: dict[str, str], name: str) -> str:
    """Reads the value of one name from a header's `format EVT21;endianness=legacy;...`, "" where it is absent."""
    return dict(re.findall(r";(\w+)=(\w+)", header.get("format", ""))).get(name, "")


def geometry_of(header: dict[str, str], warnings: list[str]) -> tuple[int, int]:
    """Returns the width and height from `geometry 640x480` or `format ...;height=480;width=640`; 0, 0 where there is
    none.
    """
    found = re.fullmatch(r"(\d{1,9})x(\d{1,9})", header.get("geometry", ""))
    width, height = (int(found[1]), int(found[2])) if found else (0, 0)
    if not found:
        parts = dict(re.findall(r";(width|height)=(\d{1,9})(?=;|$)", header.get("format", "")))
        parts = parts or {k: header[k] for k in ("width", "height") if re.fullmatch(r"\d{1,9}", header.get(k, ""))}
        if len(parts) == 2:
            width, height = int(parts["width"]), int(parts["height"])
    if width > 2048 or height > 2048 or (found and not width * height):
        warnings.append(f"the header's geometry {width}x{height} is not possible (1 to 2048) and was not used")
        return 0, 0
    return (width, height) if width and height else (0, 0)


def family_of(header: dict[str, str]) -> tuple[int, int]:
    """Returns the width and height of the sensor that the header names by plug-in, name or generation; 0, 0 where it
    does not.
    """
    generation = header.get("sensor_generation", header.get("generation", ""))
    names = f"{header.get('plugin_name', '')} {header.get('sensor_name', '')} gen{generation}".lower()
    return next(((w, h) for pattern, w, h in _FAMILIES if re.search(pattern, names)), (0, 0))
