"""Finds something bright that moves, in the events of one interval."""

from __future__ import annotations

import numpy as np


def midway(x: np.ndarray, y: np.ndarray, p: np.ndarray, size: tuple[int, int], least: int) -> np.ndarray | None:
    """Finds where a bright thing was halfway through the interval, (column, row) float64 [2] px, or None.

    Pixels that grew brighter are where it has come, those that grew darker where it was: the middle of both centres is
    the middle of its way, also where it has moved by less than its own size and both are crescents.

    Args:
        x, y, p: events of one interval.
        size: width and height of the image [px].
        least: events of one sign beyond those of the other that a pixel must have, so that the contrast of what is
            behind, as it passes by, does not count.
    """
    width, height = size
    cell = y.astype(np.int64) * width + x
    net = np.bincount(cell, np.where(p > 0, 1.0, -1.0), minlength=width * height)
    centres = []
    for found in (net >= least, net <= -least):
        cells = np.flatnonzero(found)
        if not len(cells):
            return None
        centres.append(np.array([(cells % width).mean(), (cells // width).mean()]))
    return (centres[0] + centres[1]) / 2
