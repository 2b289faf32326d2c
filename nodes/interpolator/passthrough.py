"""`none`: no interpolation. Every keyframe is a frame, for scenes whose keyframes are rendered at the full rate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nodes.interpolator.keyframe import Report, View


class Passthrough:
    """One frame per keyframe, margin cropped."""

    def __init__(self, margin: int) -> None:
        self._margin = margin

    def between(self, a: View, b: View, held: Sequence[bool] | np.ndarray, out: np.ndarray) -> Report:
        """See Method; out has K = 1."""
        crop(b, self._margin, out)
        return Report()


def crop(view: View, margin: int, out: np.ndarray) -> None:
    """The keyframe without its margin as every frame of out."""
    image = view.image.numpy()
    out[:] = image[:, None, margin : image.shape[1] - margin, margin : image.shape[2] - margin]
