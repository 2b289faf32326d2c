"""Frames whose headers state more pixels than there is memory: one error with the file's name."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib

import numpy as np
import pytest

from evis.media.frames.open import open_frames
from evis.media.frames.source import FrameOptions, FramesError


def png(side: int) -> bytes:
    """A grey PNG of one row of data."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    head = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", head)
        + chunk(b"IDAT", zlib.compress(bytes(side + 1)))
        + chunk(b"IEND", b"")
    )


def test_png(tmp_path):
    """12,000 x 12,000 pixels in 200 bytes: refused before they are unpacked."""
    (tmp_path / "f0.png").write_bytes(png(12_000))
    with pytest.raises(FramesError, match=r"f0\.png: .*EVIS_UNPACK_LIMIT"):
        open_frames(tmp_path, FrameOptions(fps=10))


def test_npz(tmp_path):
    """A frame of 65536 x 65536 in an archive, and 10^12 frames with times by --fps."""
    for shape in ((1, 65536, 65536), (10**12, 2, 2)):
        with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
            out = io.BytesIO()
            np.lib.format.write_array_header_1_0(out, {"descr": "<f4", "fortran_order": False, "shape": shape})
            archive.writestr("luminance.npy", out.getvalue() + bytes(1000))
        with pytest.raises(FramesError, match=r"a\.npz: "):
            for _ in open_frames(tmp_path / "a.npz", FrameOptions(fps=10)).blocks():
                pass


def test_whatever_a_decoder_raises_names_the_file(tmp_path, monkeypatch):
    """Memory that is not there, too; a mistake of the program passes as it is."""
    from evis.media.frames import images as frames_images

    (tmp_path / "f0.png").write_bytes(png(8))
    for fault, kind in (
        (MemoryError("1 GiB"), FramesError),
        (ValueError("odd"), FramesError),
        (KeyError("x"), KeyError),
    ):
        monkeypatch.setattr(frames_images, "codes", lambda file, form: np.zeros((8, 8), np.uint8))
        monkeypatch.setattr(frames_images, "shaped", lambda *a, fault=fault: (_ for _ in ()).throw(fault))
        with pytest.raises(kind) as raised:
            open_frames(tmp_path, FrameOptions(fps=10))
        assert kind is KeyError or "f0.png" in str(raised.value)
