"""Makes the picture of a sequence: what its first camera sees in the middle of it, for the contact sheet."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from evis.bag.preview import tone_map
from evis.gpu.host_copies import host_array
from evis.simulation.picture import as_png

FRAME = "frame.png"
"""Its name in the folder of a sequence."""


def write_frame(folder: Path, keyframe: Any) -> None:
    """Writes linear light, [1, H, W, 3] or [1, H, W], numpy's or Warp's, as a PNG."""
    light = host_array(keyframe)[0].astype(np.float32)
    if light.ndim == 2:
        light = np.repeat(light[..., None], 3, axis=2)
    (folder / FRAME).write_bytes(as_png(tone_map(light)))
