"""Events as a fading picture, and two pictures side by side with captions. Pure numpy and Pillow."""

from __future__ import annotations

from typing import Any

import numpy as np

GROUND = np.array([10, 12, 16], np.float32)
ON = np.array([255, 173, 77], np.float32)
OFF = np.array([85, 168, 255], np.float32)
"""Warm and cool at equal lightness on near-black, as on the live page; told apart by colour-blind readers too."""
_PAPER = (22, 25, 34)
_TEXT = (223, 227, 236)
_MUTED = (141, 149, 168)


def event_picture(
    t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray, width: int, height: int, at_ns: int, tau_ns: int
) -> np.ndarray:
    """The newest event of each pixel until `at_ns`, faded by exp(-(at - t) / tau): uint8 [height, width, 3].

    t: int64 [n] ns, ascending; x, y: [n] pixels, those outside the picture are left out; p: [n], 1 = ON.
    """
    first, last = np.searchsorted(t, [at_ns - 5 * tau_ns, at_ns], side="right")
    t, x, y, p = t[first:last], x[first:last], y[first:last], p[first:last]
    inside = (x < width) & (y < height)
    picture = np.empty((height, width, 3), np.float32)
    picture[:] = GROUND
    strength = np.exp((t[inside] - at_ns) / tau_ns).astype(np.float32)[:, None]
    colour = np.where((p[inside] != 0)[:, None], ON, OFF)
    # Where a pixel has several events numpy keeps the last one assigned, the newest.
    picture[y[inside], x[inside]] = GROUND + strength * (colour - GROUND)
    return np.round(picture).astype(np.uint8)


def beside(left: np.ndarray, right: np.ndarray, captions: tuple[str, str], note: str, scale: int = 1) -> Any:
    """A Pillow image of two pictures (uint8 [H, W, 3]) with a caption under each and a note at the right.

    `scale` repeats every pixel that often.
    """
    from PIL import Image, ImageDraw, ImageFont

    pictures = [Image.fromarray(p) for p in (left, right)]
    sizes = [(p.width * scale, p.height * scale) for p in pictures]
    edge, gap, foot = 6 * scale, 6 * scale, 20 * scale
    width = 2 * edge + gap + sizes[0][0] + sizes[1][0]
    sheet = Image.new("RGB", (width, edge + max(s[1] for s in sizes) + foot), _PAPER)
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(11 * scale)
    at = edge
    for picture, size, caption in zip(pictures, sizes, captions):
        sheet.paste(picture.resize(size, Image.Resampling.NEAREST), (at, edge))
        pen.text((at + 1, edge + size[1] + 4 * scale), caption, _TEXT, font)
        at += size[0] + gap
    pen.text((width - edge - 1, edge + sizes[1][1] + 4 * scale), note, _MUTED, font, anchor="ra")
    return sheet


def palette(frames: np.ndarray, colours: int = 96) -> Any:
    """A Pillow palette image for `beside`: the fading event colours, the captions', and `colours` for the frames.

    frames: uint8 [n, H, W, 3]. The events have colours of their own, since they cover too few pixels to be given any
    by their number.
    """
    from PIL import Image

    fade = np.linspace(0, 1, 20)[:, None]
    events = np.concatenate([GROUND + fade * (colour - GROUND) for colour in (ON, OFF)])
    mix = np.linspace(0, 1, 6)[:, None]
    paper = np.array(_PAPER)
    texts = np.concatenate([paper + mix * (np.array(colour) - paper) for colour in (_TEXT, _MUTED)])
    mosaic = Image.fromarray(frames[:: max(1, len(frames) // 6)].reshape(-1, frames.shape[2], 3))
    own = mosaic.quantize(colours).getpalette() or []
    result = Image.new("P", (1, 1))
    result.putpalette([*np.round(np.concatenate([events, texts])).astype(np.uint8).reshape(-1).tolist(), *own])
    return result
