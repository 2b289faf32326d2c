"""Draws docs/frame_camera.png, images of three exposures beside the events: `python docs/frame_camera.py`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

import evis
from evis.events.arrays import Events
from evis.media.pictures.event_pictures import draw

PICTURE = Path(__file__).with_suffix(".png")
SCENE, GIVEN = (
    "fidget_spinner",
    {"width": 346, "height": 260, "preset": "davis346", "image_sensitivity": 4e5, "upsampling": 64},
)
PANELS = (
    ("1 ms", {"exposure_ms": 1.0, "image_gain": 16.0, "image_phase_ms": 19.5}),
    ("16 ms: motion blur", {"exposure_ms": 16.0, "image_gain": 1.0, "image_phase_ms": 12.0}),
    (
        "1 ms, rolling shutter of 100 us a row",
        {"exposure_ms": 1.0, "image_gain": 16.0, "image_phase_ms": 6.55, "rolling_shutter_us": 100.0},
    ),
)
"""Caption, and what the frame camera is told: the same brightness and middle of the exposure in each."""
STEPS = 3
EDGE, FOOT = 6, 20


def main() -> None:
    """Makes the picture."""
    tiles = []
    for caption, given in PANELS:
        with evis.Simulation(SCENE, outputs=["events", "image"], image_gamma=2.2, **GIVEN, **given) as sim:
            steps = [sim.reset(), *(sim.step() for _ in range(STEPS))]
        image = steps[-1].image
        assert image is not None
        grey = (image.data[..., 0] >> 8).astype(np.uint8)
        tiles.append((np.repeat(grey[..., None], 3, axis=2), caption))
        packet = steps[-1].events
    middle = steps[-2].stamp_ns + 20_000_000
    window = abs(packet.t - middle) <= 1_000_000
    chosen = Events(*(getattr(packet, name)[window] for name in "txyp"))
    tiles.append((draw(chosen, 346, 260), "events of 2 ms about the middle"))
    height, width = tiles[0][0].shape[:2]
    sheet = Image.new("RGB", (2 * (width + EDGE) + EDGE, 2 * (height + FOOT) + EDGE), "white")
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(12)
    for n, (pixels, caption) in enumerate(tiles):
        x, y = EDGE + (n % 2) * (width + EDGE), EDGE + (n // 2) * (height + FOOT)
        sheet.paste(Image.fromarray(pixels), (x, y))
        pen.text((x, y + height + 3), caption, fill=(30, 30, 46), font=font)
    sheet.quantize(128).save(PICTURE, optimize=True)
    print(PICTURE)


if __name__ == "__main__":
    main()
