"""Finds the picture among the channels of an EXR file, for frames and for what surfaces and skies are made of."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from evis.media.exr_chroma import CHROMA, REC_709, rgb_of

COLOUR = ("R", "G", "B")
GREY = "Y"
"""Names of a picture's channels; Z, ids and others stand beside them."""
KINDS = {"float16": "half", "float32": "float", "uint32": "uint"}
NAMED = 8
"""Channels that an error names."""


def picture_of(channels: Mapping[str, np.ndarray], header: Mapping[str, Any]) -> np.ndarray | None:
    """Gives the picture of half or float among separate channels, [h, w] or [h, w, 3]; None where there is none.

    R, G and B need not all be of one kind: float is taken then. Luminance with chroma (Y, RY, BY) gives R, G and B; a Y
    with only one of these is no picture. Raises ValueError for luminance and chroma that do not go together.
    """
    colours = [channels[name] for name in COLOUR if name in channels]
    if len(colours) == len(COLOUR) and all(_fits(one) and one.shape == colours[0].shape for one in colours):
        return np.stack(colours, axis=-1)
    grey = channels.get(GREY)
    if grey is None or not _fits(grey):
        return None
    ry, by = (channels.get(name) for name in CHROMA)
    if ry is None and by is None:
        return grey
    if ry is None or by is None or not (_fits(ry) and _fits(by)):
        return None
    return rgb_of(grey, ry, by, header.get("chromaticities", REC_709))


def without_picture(channels: Mapping[str, np.ndarray]) -> str:
    """Tells that there is no picture among channels, which there are, and of which kinds."""
    names = sorted(channels)
    kinds = [KINDS.get(str(channels[name].dtype), str(channels[name].dtype)) for name in names]
    listed = ", ".join(f"{name} ({kind})" for name, kind in zip(names[:NAMED], kinds))
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    layers = "; layers are not read, so save it as a single one" if any(n.endswith(".R") for n in names) else ""
    chroma = "; Y is read alone, or with both RY and BY" if GREY in channels else ""
    return f"no R, G and B, and no Y, of half or float; it has {listed or 'none'}{more}{layers}{chroma}"


def _fits(channel: np.ndarray) -> bool:
    return channel.ndim == 2 and channel.dtype.kind == "f"
