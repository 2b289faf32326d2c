"""Writes images of a bag as a folder of PNG files (ISO/IEC 15948), with the times that `evis events simulate` reads."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from evis.bag import BagError
from evis.files.whole_file import whole_file
from evis.media.frames.folder import TIMES
from msgs.camera import Image
from msgs.header import Message

_GREY, _COLOUR = 0, 2
_SUB = 1
"""The filter of rows: differences to the pixel before. They pack better than pixels, and several times faster."""
_LEVEL = 1
"""Compression level of zlib: a higher one makes files smaller by a quarter and takes five times as long."""


def write_folder(messages: Iterable[Message], topic: str, out: Path) -> dict[str, Any]:
    """Writes one file per image, 000000.png and so on, and times.txt with `name t_ns` lines. Raises BagError.

    8 and 16 bit, grey and colour, as they were recorded. `other_files` counts PNG files of another export.
    """
    out.mkdir(parents=True, exist_ok=True)
    lines: list[str] = []
    for message in messages:
        assert isinstance(message, Image)
        name = f"{len(lines):06d}.png"
        try:
            data = encoded(np.asarray(message.data), message.encoding)
        except ValueError as error:
            raise BagError(f"{topic}: {error}; export to .npz or .jsonl") from None
        _whole(out / name, data, len(lines))
        lines.append(f"{name} {message.header.stamp_ns}\n")
    _whole(out / TIMES, "".join(lines).encode(), len(lines))
    others = len(list(out.glob("*.png"))) - len(lines)
    return {"images": len(lines), "times": str(out / TIMES), **({"other_files": others} if others else {})}


def encoded(pixels: np.ndarray, encoding: str) -> bytes:
    """Encodes a PNG file of pixels uint8 or uint16 [H, W, C]. Raises ValueError for what PNG does not have."""
    height, width, channels = pixels.shape
    if pixels.dtype not in (np.uint8, np.uint16) or channels not in (1, 3) or not pixels.size:
        raise ValueError(f"an image of {width} x {height}, encoding {encoding}, is none that PNG can hold")
    if encoding.startswith("bgr"):
        pixels = pixels[..., ::-1]
    depth = 8 * pixels.itemsize
    wire = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder(">")).view(np.uint8).reshape(height, -1)
    rows = np.empty((height, 1 + wire.shape[1]), np.uint8)
    behind = channels * pixels.itemsize
    rows[:, 0], rows[:, 1 : 1 + behind] = _SUB, wire[:, :behind]
    np.subtract(wire[:, behind:], wire[:, :-behind], out=rows[:, 1 + behind :])
    head = struct.pack(">IIBBBBB", width, height, depth, _COLOUR if channels == 3 else _GREY, 0, 0, 0)
    parts = (b"IHDR", head), (b"IDAT", zlib.compress(rows.tobytes(), _LEVEL)), (b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(_part(kind, data) for kind, data in parts)


def _part(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _whole(path: Path, data: bytes, done: int) -> None:
    try:
        with whole_file(path) as partial:
            partial.write_bytes(data)
    except OSError as error:
        raise BagError(f"{error}; the {done} images before it are whole") from None
