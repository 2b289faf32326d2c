"""Reads a picture of the user's as a texture."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from evis.scene.errors import SceneError
from evis.scene.images.pictures import check_picture, load_exr, load_picture

WHITE = 1.0 + 1e-3
"""Brightest texel of an EXR: more reflects more light than falls on it."""


def check_file(path: Path) -> None:
    """Looks at the header of a picture, of an EXR at all of it. Raises SceneError that names it."""
    if path.suffix.lower() == ".exr":
        read_picture(path)
        return
    try:
        check_picture(path)
    except SceneError as error:
        raise SceneError(_said(path, error)) from None


def read_picture(path: Path, size: int = 0) -> np.ndarray:
    """Reads a picture as reflectance, linear float32 [h, w, 3], no longer than `size` texels where above 0.

    PNG, JPEG and TIFF are taken as sRGB, EXR as linear. Raises SceneError that names it.
    """
    try:
        image = load_exr(path) if path.suffix.lower() == ".exr" else load_picture(path)
    except SceneError as error:
        raise SceneError(_said(path, error)) from None
    if image.max() > WHITE:
        raise SceneError(f"{path.name} has texels up to {image.max():g}; reflectance is at most 1, so scale it down")
    image = np.minimum(image, 1.0)
    return shrunk(image, size) if size else image


def _said(path: Path, error: SceneError) -> str:
    """What is wrong with a picture, as a sentence about it."""
    text = str(error)
    return text if text.startswith(path.name) else f"{path.name} is {text.removeprefix('which is ')}"


def shrunk(image: np.ndarray, size: int) -> np.ndarray:
    """Scales a linear picture so that its longer side has at most `size` texels, each the mean of what it covers."""
    from PIL import Image

    longer = max(image.shape[:2])
    if longer <= size:
        return image
    height, width = (max(1, round(n * size / longer)) for n in image.shape[:2])
    channels = [Image.fromarray(np.ascontiguousarray(image[..., c])) for c in range(3)]
    small = [np.asarray(channel.resize((width, height), Image.Resampling.BOX)) for channel in channels]
    return np.clip(np.stack(small, axis=-1), 0.0, 1.0).astype(np.float32)
