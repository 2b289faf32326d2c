"""Reads frames as a folder of PNG, JPEG, TIFF, BMP or PGM files, 8 to 16 bit, made linear by an inverse tone curve."""

from __future__ import annotations

import io
import re
import warnings
from pathlib import Path

import numpy as np

from evis.files.allowance import Allowance
from evis.files.damage import error_text
from evis.media.deep_colour import deep_colour
from evis.media.frames.ends import ends_of
from evis.media.frames.folder import FolderFrames
from evis.media.frames.source import PIXEL_BYTES, FrameOptions, FramesError
from evis.media.frames.tone import shaped

KINDS = {
    ".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG", ".tif": "TIFF", ".tiff": "TIFF", ".bmp": "BMP", ".pgm": "PPM"
}  # fmt: skip
"""Formats by the end of a file's name, as Pillow calls them."""
_LARGEST_CODE = re.compile(rb"P[25]\s(?:\s*#[^\n]*\n)*\s*\d+\s+\d+\s+(\d+)")
"""The header of a PGM, in which cameras of 10 and 12 bits say so."""


class ImageFrames(FolderFrames):
    """Reads a folder of PNG, JPEG, TIFF, BMP or PGM files, grey, RGB or palette; alpha is left out."""

    def __init__(self, path: Path, names: list[str], options: FrameOptions, form: str) -> None:
        """form: one of KINDS, that of all files."""
        self._tone, self._form, self.kind = options.make_tone(), form, form.lower()
        self.tone = self._tone
        self._ends = options.ends
        super().__init__(path, names, options)
        self.about |= {"tone": self._tone.name, "white": self._tone.white}

    def _read(self, path: Path) -> tuple[np.ndarray, int | None, np.ndarray | None]:
        try:
            file = path.read_bytes()
            read = codes(file, self._form)
        except Exception as error:  # Pillow raises OSError, SyntaxError, ValueError and others for damaged files
            raise FramesError(f"{path}: cannot be read as {self._form}: {error_text(error, 150)}") from None
        header = _LARGEST_CODE.match(file)
        self.about["bits"] = 8 * read.itemsize if header is None else int(header[1]).bit_length()
        return shaped(read, self._tone, self.channels == 3), None, ends_of(read) if self._ends else None


def codes(file: bytes, form: str = "PNG") -> np.ndarray:
    """Reads the bytes of a file of this format, uint8 or uint16 [H, W] or [H, W, 3], without alpha, turned as the
    file says that it is looked at. Raises what Pillow raises, and ValueError.
    """
    from PIL import Image, ImageOps, UnidentifiedImageError

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # what is too large is refused here
        warnings.simplefilter("ignore", UserWarning)  # damage is an error below
        try:
            first = Image.open(io.BytesIO(file), formats=[form])
        except UnidentifiedImageError:
            # Pillow's text has the address of the bytes in memory
            raise ValueError(f"it does not begin as {form} does: it is damaged, or of another format") from None
    with first as image:
        Allowance(len(file)).check(image.width * image.height * PIXEL_BYTES)
        if getattr(image, "n_frames", 1) > 1 and form == "TIFF":
            raise ValueError(f"it holds {getattr(image, 'n_frames', 0)} pages; write each to a file of its own")
        if image.mode in ("I", "I;16", "I;16B"):
            return _of_16_bits(np.asarray(image))
        if image.mode == "F":
            raise ValueError("its pixels are floats; write linear floats as EXR or .npz")
        deep = deep_colour(image)
        if deep is not None:
            return deep
        # Pillow turns a TIFF itself.
        turned = ImageOps.exif_transpose(image) if form == "JPEG" else image
        return np.asarray(turned.convert("L" if image.mode in ("1", "L", "LA") else "RGB"))


def _of_16_bits(pixels: np.ndarray) -> np.ndarray:
    """Returns whole numbers as uint16. Raises ValueError where one is below 0 or above 65535: TIFF may have them."""
    low, high = int(pixels.min()), int(pixels.max())
    if low < 0 or high > np.iinfo(np.uint16).max:
        raise ValueError(f"its pixels are {low} to {high}, beyond 16 bits; write 8 or 16 bits, or linear floats as EXR")
    return pixels.astype(np.uint16)
