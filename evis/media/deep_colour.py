"""Reads colour of 16 bits a channel, of which Pillow keeps the high bytes alone."""

from __future__ import annotations

import io
import warnings
from typing import Any

import numpy as np

_COLOUR = ("RGB;16", "RGBA;16", "RGBX;16")
"""Beginnings of the raw modes of such colour; after them comes the order of bytes."""
_GREY_AND_ALPHA = "LA;16B"


def deep_colour(picture: Any) -> np.ndarray | None:
    """Reads a picture that Pillow has open, as uint16 [H, W, 3] without alpha; None where it has no colour of 16 bits,
    nor grey of 16 bits with alpha.

    The picture must not be loaded yet, and is not loaded after it. Raises what Pillow raises for damaged files.
    """
    tiles = getattr(picture, "tile", None)
    rawmode = str(_rawmode(tiles[0].args)) if tiles else ""
    if rawmode == _GREY_AND_ALPHA:
        # Two numbers of two bytes each are as long as four of one.
        grey = _read_as(picture, "RGBA")[..., :2].astype(np.uint16)
        return np.repeat((grey[..., :1] << 8) | grey[..., 1:], 3, axis=2)
    if not rawmode.startswith(_COLOUR):
        return None
    # Read as if the bytes were in the other order, it gives the low ones.
    other = rawmode[:-1] + ("L" if rawmode.endswith("B") else "B")
    high, low = (_read_as(picture, order)[..., :3].astype(np.uint16) for order in (rawmode, other))
    return (high << 8) | low


def _read_as(picture: Any, rawmode: str) -> np.ndarray:
    """The texels of a picture's file, uint8, as if they lay in it as a raw mode says."""
    from PIL import Image

    picture.fp.seek(0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # who opened it has checked its size
        again = Image.open(io.BytesIO(picture.fp.read()), formats=[picture.format])
    with again:
        again.tile = [tile._replace(args=_with_rawmode(tile.args, rawmode)) for tile in again.tile]
        return np.asarray(again)


def _rawmode(args: Any) -> Any:
    """How the bytes of a pixel lie in the file, as the first of a decoder's arguments says."""
    return args[0] if isinstance(args, tuple) else args


def _with_rawmode(args: Any, rawmode: str) -> Any:
    return (rawmode, *args[1:]) if isinstance(args, tuple) else rawmode
