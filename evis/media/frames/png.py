"""Frames as a folder of PNG files, 8 or 16 bit, made linear by an inverse tone curve."""

from __future__ import annotations

import io
import warnings
from pathlib import Path

import numpy as np

from evis.files.allowance import Allowance
from evis.media.frames.folder import FolderFrames
from evis.media.frames.source import PIXEL_BYTES, FrameOptions, FramesError
from evis.media.frames.tone import shaped


class PngFrames(FolderFrames):
    """Reads a folder of PNG files, grey, RGB or palette; alpha is left out."""

    kind = "png"

    def __init__(self, path: Path, names: list[str], options: FrameOptions) -> None:
        self._tone = options.make_tone()
        super().__init__(path, names, options)
        self.about |= {"tone": self._tone.name, "white": self._tone.white}

    def _read(self, path: Path) -> tuple[np.ndarray, int | None]:
        try:
            read = codes(path.read_bytes())
        except Exception as error:  # Pillow raises OSError, SyntaxError, ValueError and others for damaged files
            raise FramesError(f"{path}: cannot be read as PNG: {' '.join(str(error).split())[:150]}") from None
        return shaped(read, self._tone, self.channels == 3), None


def codes(file: bytes) -> np.ndarray:
    """Reads the bytes of a PNG file, uint8 or uint16 [H, W] or [H, W, 3], without alpha. Raises what Pillow raises."""
    from PIL import Image

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # what is too large is refused here
        first = Image.open(io.BytesIO(file), formats=["PNG"])
    with first as image:
        Allowance(len(file)).check(image.width * image.height * PIXEL_BYTES)
        rawmode = image.tile[0].args if image.tile else None
        if image.mode in ("I", "I;16"):
            return np.asarray(image).astype(np.uint16)
        if rawmode in ("RGB;16B", "RGBA;16B"):
            high = np.asarray(image)
        else:
            mode = "L" if image.mode in ("1", "L", "LA") else "RGB"
            if rawmode == "LA;16B":
                raise ValueError("16 bit grey with alpha is not supported; save it without alpha")
            return np.asarray(image.convert(mode))
    # Pillow gives 16 bit colour as its high bytes; read as if little-endian, it gives the low ones
    with Image.open(io.BytesIO(file), formats=["PNG"]) as image:
        image.tile = [tile._replace(args=str(rawmode).replace("16B", "16L")) for tile in image.tile]
        low = np.asarray(image)
    return (high[..., :3].astype(np.uint16) << 8) | low[..., :3]
