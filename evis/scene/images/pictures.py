"""Opens the pictures that surfaces and skies are made of, in this one place, and says how large they may be.

The size is read from the header and checked before anything is unpacked.
"""

from __future__ import annotations

import io
import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from evis.files.allowance import Allowance, AllowanceError
from evis.files.damage import error_text
from evis.media import exr_window
from evis.media.deep_colour import deep_colour
from evis.media.exr_channels import picture_of, without_picture
from evis.scene.errors import SceneError
from evis.scene.images.colour import linear_from_codes
from evis.scene.sources import note

MAX_TEXELS = 1 << 26
"""Largest picture, as 8192 x 8192 [texels]."""
TEXEL = 12
"""Bytes of a texel as scenes have it, three float32."""
EXR = b"\x76\x2f\x31\x01"
"""First bytes of an EXR file."""
FORMATS = ("PNG", "JPEG", "BMP", "GIF", "PPM", "TGA", "TIFF", "WEBP")
"""Of what Pillow reads: some of its other formats run programs."""


def check_size(width: int, height: int, read: int, texel: int = TEXEL) -> None:
    """Raises SceneError for a picture that is too large, also for the `read` bytes it was packed in.

    texel: bytes of each unpacked. The text begins with the size; the caller puts the name before it.
    """
    if width < 1 or height < 1 or width * height > MAX_TEXELS:
        side = math.isqrt(MAX_TEXELS)
        raise SceneError(f"of {width} x {height} px; 1 to {MAX_TEXELS} texels can be read, as {side} x {side}")
    try:
        Allowance(read).check(width * height * texel)
    except AllowanceError as error:
        raise SceneError(f"of {width} x {height} px: {error}") from None


def check_picture(source: Path | bytes) -> None:
    """Raises SceneError for what is no picture or too large a one, from its header. The caller puts the name before."""
    with _opened(source):
        pass


def load_picture(source: Path | bytes) -> np.ndarray:
    """Loads a PNG, JPEG or other picture of 8 or 16 bits a channel, taken as sRGB, as linear float32 [h, w, 3].

    Raises SceneError whose text the caller puts the name before.
    """
    with _opened(source) as picture:
        return linear_from_codes(codes_of(picture))


def lets_through(source: Path) -> bool:
    """Tells whether a picture that can be read, other than EXR, has texels less than opaque."""
    with _opened(source) as picture:
        if "A" not in picture.getbands() and "transparency" not in picture.info:
            return False
        return int(picture.convert("RGBA").getchannel("A").getextrema()[0]) < 255


def codes_of(picture: Any) -> np.ndarray:
    """Returns the values of a picture that Pillow has open and has not loaded, uint8 or uint16 [h, w, 3], all bits of
    16. Raises SceneError as `load_picture`.
    """
    try:
        if picture.mode.startswith("I;16"):  # grey, of which Pillow's conversion would leave the lowest 8 bits
            return np.repeat(np.asarray(picture).astype(np.uint16)[..., None], 3, axis=2)
        if picture.mode in ("I", "F"):
            raise ValueError(f"its texels are of the kind {picture.mode}; save it with 8 or 16 bits a channel")
        deep = deep_colour(picture)
        return np.asarray(picture.convert("RGB")) if deep is None else deep
    except Exception as error:  # Pillow raises OSError, SyntaxError, ValueError and others for damaged files
        raise SceneError(f"which is a damaged picture: {error_text(error, 150)}") from None


def _opened(source: Path | bytes) -> Any:
    from PIL import Image, UnidentifiedImageError

    read = len(source) if isinstance(source, bytes) else note(source).stat().st_size
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # the check below is stricter
            picture = Image.open(io.BytesIO(source) if isinstance(source, bytes) else source, formats=FORMATS)
    except Image.DecompressionBombError:
        raise SceneError(f"of more than {MAX_TEXELS} texels, which is the most that can be read") from None
    except UnidentifiedImageError:  # whose text has the place of a picture within another file in memory
        raise SceneError("which is no picture: it is of no kind that can be read, or damaged; save it as PNG") from None
    except Exception as error:
        raise SceneError(f"which is no picture: {error_text(error, 150)}") from None
    try:
        check_size(*picture.size, read)
    except SceneError:
        picture.close()
        raise
    return picture


def load_exr(path: Path) -> np.ndarray:
    """Loads R, G, B (or Y, or Y, RY and BY) of an EXR file, float32 [h, w, 3]. Raises SceneError naming it."""
    import OpenEXR

    with note(path).open("rb") as file:
        if file.read(len(EXR)) != EXR:
            raise SceneError(f"{path.name} cannot be read as EXR: it begins as none does; convert it to EXR")
    try:
        with OpenEXR.File(str(path), header_only=True) as file:
            headers = [dict(file.header(i)) for i in range(len(file.parts))]
        for header in headers:
            for window in (exr_window.DATA, exr_window.DISPLAY):
                width, height = exr_window.sides(header, window)
                check_size(width, height, path.stat().st_size // len(headers), 4 * max(3, len(header["channels"])))
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {name: channel.pixels for name, channel in file.channels().items()}
    except SceneError as error:
        raise SceneError(f"{path.name} is {error}") from None
    except Exception as error:  # the library raises RuntimeError, TypeError and others for damaged files
        raise SceneError(f"{path.name} cannot be read as EXR: {error_text(error, 150)}") from None
    try:
        pixels = picture_of(channels, headers[0])
    except ValueError as error:
        raise SceneError(f"{path.name}: {error}") from None
    if pixels is None:
        raise SceneError(f"{path.name} has {without_picture(channels)}")
    pixels = exr_window.displayed(pixels, headers[0])
    if pixels.ndim == 2 or pixels.shape[2] < 3:
        grey = pixels if pixels.ndim == 2 else pixels[..., 0]
        pixels = np.repeat(grey[..., None], 3, axis=2)
    image = np.ascontiguousarray(pixels[..., :3], np.float32)
    bad = ~np.isfinite(image).all(axis=-1)
    if bad.any():
        row, column = np.argwhere(bad)[0]
        count = int(bad.sum())
        raise SceneError(f"{path.name} has {count} texels that are not finite, the first in row {row}, column {column}")
    if image.min() < 0:
        raise SceneError(f"{path.name} has radiance below 0, {image.min():g}; light cannot be negative")
    return image
