"""Finds the region of interest that a camera's settings ask for: roi_x, roi_y, roi_width and roi_height."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Region:
    """Describes a rectangle of pixels by its first column and row and its size [px]."""

    left: int
    top: int
    width: int
    height: int

    @property
    def right(self) -> int:
        """Returns the last column, which belongs to it."""
        return self.left + self.width - 1

    @property
    def bottom(self) -> int:
        """Returns the last row, which belongs to it."""
        return self.top + self.height - 1


def region_of(settings: Any, width: int, height: int) -> Region:
    """Gives the region of interest of a sensor of this size; a length of 0 goes to the edge.

    Raises ValueError for one that does not lie inside the sensor.
    """
    x, y = settings.roi_x, settings.roi_y
    w, h = settings.roi_width or width - x, settings.roi_height or height - y
    if x + w > width or y + h > height or w <= 0 or h <= 0:
        raise ValueError(f"roi {x},{y} {w}x{h} px does not lie inside {width}x{height}")
    return Region(x, y, w, h)
