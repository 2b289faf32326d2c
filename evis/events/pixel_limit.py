"""Limits maps with a value for every pixel of a sensor: how large a sensor may be that a file's header states."""

from __future__ import annotations

from evis.files.allowance import Allowance, AllowanceError

PIXEL_BYTES = 64
"""Memory per pixel while events are measured or drawn, intermediate results included [bytes]."""
MOST = 1 << 30
"""Memory that the maps of a sensor may take unless EVIS_UNPACK_LIMIT says otherwise: 16 million pixels."""


def check_pixels(width: int, height: int) -> None:
    """Raises AllowanceError where maps of a sensor of this size [px] take more memory than they may."""
    needed, limit = width * height * PIXEL_BYTES, Allowance(0, base=MOST).limit
    if needed > limit:
        raise AllowanceError(
            f"a sensor of {width}x{height} pixels takes {needed / 1e9:.3g} GB of memory, over the limit of "
            f"{limit / 1e9:.3g} GB; give the true size with --size WxH, or set "
            f"EVIS_UNPACK_LIMIT={-(-needed >> 30)}G"
        )
