"""Draws two pictures side by side with captions, and the palette that both share in a GIF."""

from __future__ import annotations

from typing import Any

import numpy as np

from evis.media.pictures.event_pictures import ON_BLACK

_PAPER = (22, 25, 34)
_TEXT = (223, 227, 236)
_MUTED = (141, 149, 168)


def beside(left: np.ndarray, right: np.ndarray, captions: tuple[str, str], note: str, scale: int = 1) -> Any:
    """Draws a Pillow image of two pictures (uint8 [H, W, 3]) with a caption under each and a note at the right.

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
    """Makes a Pillow palette image for `beside`: the fading event colours, the captions', and `colours` for the frames.

    frames: uint8 [n, H, W, 3]. The events have colours of their own, since they cover too few pixels to be given any
    by their number.
    """
    from PIL import Image

    fade = np.linspace(0, 1, 20)[:, None]
    ground, on, off = (np.array(colour, np.float32) for colour in ON_BLACK)
    events = np.concatenate([ground + fade * (colour - ground) for colour in (on, off)])
    mix = np.linspace(0, 1, 6)[:, None]
    paper = np.array(_PAPER)
    texts = np.concatenate([paper + mix * (np.array(colour) - paper) for colour in (_TEXT, _MUTED)])
    mosaic = Image.fromarray(frames[:: max(1, len(frames) // 6)].reshape(-1, frames.shape[2], 3))
    own = mosaic.quantize(colours).getpalette() or []
    result = Image.new("P", (1, 1))
    result.putpalette([*np.round(np.concatenate([events, texts])).astype(np.uint8).reshape(-1).tolist(), *own])
    return result
