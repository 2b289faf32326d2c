"""Declares the settings of a region of interest (roi_x, roi_y, roi_width, roi_height) and checks them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from nodes.camera.interface.settings import setting

ROI = ("roi_x", "roi_y", "roi_width", "roi_height")


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


def roi_left(width: int) -> Any:
    """Makes the setting `roi_x` of a sensor that is `width` pixels wide."""
    return setting(0, "left column of the region of interest", "px", 0, width - 1)


def roi_top(height: int) -> Any:
    """Makes the setting `roi_y` of a sensor that is `height` pixels high."""
    return setting(0, "top row of the region of interest", "px", 0, height - 1)


def roi_columns(width: int) -> Any:
    """Makes the setting `roi_width` of a sensor that is `width` pixels wide."""
    return setting(0, "its width; 0 = to the right edge", "px", 0, width)


def roi_rows(height: int) -> Any:
    """Makes the setting `roi_height` of a sensor that is `height` pixels high."""
    return setting(0, "its height; 0 = to the bottom edge", "px", 0, height)


def roi_differs(settings: Any, before: Any) -> bool:
    """Tells whether the region of interest is not that of `before`."""
    return any(getattr(settings, name) != getattr(before, name) for name in ROI)


def region_of(settings: Any, width: int, height: int) -> Region:
    """Returns the region of interest that the settings ask for on a sensor of this size; a length of 0 reaches to the
    edge.

    Raises ValueError for one that does not lie inside the sensor.
    """
    x, y = settings.roi_x, settings.roi_y
    w, h = settings.roi_width or width - x, settings.roi_height or height - y
    if x + w > width or y + h > height or w <= 0 or h <= 0:
        raise ValueError(f"roi {x},{y} {w}x{h} px does not lie inside {width}x{height}")
    return Region(x, y, w, h)
