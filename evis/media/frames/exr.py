"""Reads frames as a folder of OpenEXR files: linear R, G, B, or Y, or Y, RY and BY; the time is in an attribute, in
times.txt, or by --fps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from evis.files.allowance import Allowance
from evis.files.damage import error_text
from evis.media import exr_window
from evis.media.colour import luminance_of
from evis.media.exr_channels import picture_of, without_picture
from evis.media.frames.folder import FolderFrames
from evis.media.frames.source import PIXEL_BYTES, FrameOptions, FramesError

STAMPS = ("evis/stamp_ns", "evis/time_ns")
"""Attributes that hold the time; `evis bag export` writes the first."""


class ExrFrames(FolderFrames):
    """Reads a folder of EXR files, scan line or tiled, half or float. Alpha and other channels are left out."""

    kind = "exr"

    def __init__(self, path: Path, names: list[str], options: FrameOptions) -> None:
        options.refuse_tone(path, "EXR")
        super().__init__(path, names, options)

    def _read(self, path: Path) -> tuple[np.ndarray, int | None, None]:
        import OpenEXR

        try:
            with OpenEXR.File(str(path), header_only=True) as file:
                windows = [exr_window.sides(file.header(), name) for name in (exr_window.DATA, exr_window.DISPLAY)]
            # before the library asks for all of it
            Allowance(path.stat().st_size).check(max(width * height for width, height in windows) * PIXEL_BYTES)
            with OpenEXR.File(str(path), separate_channels=True) as file:
                header = dict(file.header())
                channels = {name: channel.pixels for name, channel in file.channels().items()}
        except Exception as error:  # the library raises RuntimeError, TypeError and others for damaged files
            raise FramesError(f"{path}: cannot be read as EXR: {error_text(error, 150)}") from None
        try:
            pixels = picture_of(channels, header)
        except ValueError as error:
            raise FramesError(f"{path}: {error}") from None
        if pixels is None:
            raise FramesError(f"{path}: {without_picture(channels)}")
        return self._image(exr_window.displayed(pixels, header)), _stamp(path, header), None

    def _image(self, pixels: np.ndarray) -> np.ndarray:
        if pixels.ndim == 3 and pixels.shape[2] >= 3:
            rgb = np.ascontiguousarray(pixels[..., :3], dtype=np.float32)
            return rgb if self.channels == 3 else luminance_of(rgb)
        grey = np.asarray(pixels if pixels.ndim == 2 else pixels[..., 0], np.float32)
        return np.repeat(grey[..., None], 3, axis=2) if self.channels == 3 else np.ascontiguousarray(grey)


def _stamp(path: Path, header: dict[str, Any]) -> int | None:
    value = next((header[name] for name in STAMPS if name in header), None)
    if value is None:
        return None
    try:
        stamp = int(value)
        if isinstance(value, str) or stamp == value:
            return stamp
    except (TypeError, ValueError, OverflowError):
        pass
    raise FramesError(f"{path}: its time attribute is {value!r}, must be whole nanoseconds")
