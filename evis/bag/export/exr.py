"""Writes images as one OpenEXR file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from evis.files.whole_file import whole_file


def cropped(array: Any, margin: int, env: int = 0) -> np.ndarray:
    """Copies the image of an environment without its margin: [E, H, W, ...] -> [H - 2 margin, W - 2 margin, ...].

    The writer ignores strides and copies raw memory: a view would come out wrong or crash.
    """
    image = np.asarray(array)[env]
    return np.ascontiguousarray(image[margin : image.shape[0] - margin, margin : image.shape[1] - margin])


def vectors(name: str, image: np.ndarray) -> dict[str, np.ndarray]:
    """Splits vectors [H, W, 2] into the channels NAME.x and NAME.y."""
    return {f"{name}.{axis}": np.ascontiguousarray(image[..., k]) for k, axis in enumerate("xy")}


def write(path: Path, arrays: dict[str, np.ndarray], stamp_ns: int) -> None:
    """Writes scan lines with ZIP compression, which is lossless and detects damage. The stamp is an attribute.

    Raises OSError, with nothing left of the file.
    """
    import OpenEXR

    # attributes are 32-bit numbers or texts
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, "evis/stamp_ns": str(stamp_ns)}
    with whole_file(path) as partial:
        try:
            with OpenEXR.File(header, arrays) as file:
                file.write(str(partial))
        except RuntimeError as error:
            raise OSError(f"cannot write {path}: {_reason(str(error), partial)}") from None


def _reason(text: str, partial: Path) -> str:
    """Returns the library's message without the name of the partial file."""
    return text.replace(str(partial), "").replace("Cannot write image file", "").strip(" \"'.:") or "no reason given"
