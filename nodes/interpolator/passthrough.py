"""Implements method `none`, which does not interpolate: every keyframe is a frame, for scenes whose keyframes are
rendered at the full rate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import warp as wp

from nodes.interpolator.keyframe import KeyframeView, Report


class Passthrough:
    """Passes every keyframe on as one frame, margin cropped."""

    def __init__(self, margin: int) -> None:
        self._margin = margin

    def between(
        self, a: KeyframeView, b: KeyframeView, held: Sequence[bool] | np.ndarray, out: np.ndarray | wp.array
    ) -> Report:
        """Implements `Method.between`; out has K = 1."""
        crop(b, self._margin, out)
        return Report()


def crop(view: KeyframeView, margin: int, out: np.ndarray | wp.array) -> None:
    """Copies the keyframe without its margin into the one frame of out."""
    height, width = view.image.shape[1:3]
    image = view.image[:, margin : height - margin, margin : width - margin]
    if isinstance(out, wp.array):
        if image.ndim == 4:
            whole = view.image.view(wp.vec3).reshape(view.image.shape[:3])
            image = whole[:, margin : height - margin, margin : width - margin]
        wp.copy(out[:, 0], image)
    else:
        out[:, 0] = image.numpy()
