"""Cuts a rectangle of the sensor's pixels out of events and of frames beside them."""

from __future__ import annotations

from dataclasses import replace

from evis.events.arrays import Events, Frame

Rectangle = tuple[int, int, int, int]
"""x, y of the upper left pixel, width and height [px]."""


def check_rectangle(rectangle: Rectangle, width: int, height: int) -> None:
    """Raises ValueError unless the rectangle has pixels and lies on a sensor of this size [px]."""
    x, y, columns, rows = rectangle
    if min(x, y) < 0 or min(columns, rows) < 1 or x + columns > width or y + rows > height:
        raise ValueError(f"crop {x},{y},{columns},{rows} is not inside the sensor of {width}x{height}")


def cropped(events: Events, rectangle: Rectangle) -> Events:
    """Returns what lies in a rectangle of pixels, as a sensor of that size has it: its corner is pixel (0, 0).

    Frames are cut too, and left out where nothing of them is inside; triggers and inertial samples stay as they are.
    """
    x, y, width, height = rectangle
    inside = (events.x >= x) & (events.x < x + width) & (events.y >= y) & (events.y < y + height)
    part = events[inside]
    part.x, part.y = part.x - part.x.dtype.type(x), part.y - part.y.dtype.type(y)
    part = part.beside(events)
    part.frames = [cut for frame in events.frames if (cut := _cut(frame, rectangle)) is not None]
    return part


def _cut(frame: Frame, rectangle: Rectangle) -> Frame | None:
    """Returns the part of a frame in the rectangle, None where there is none."""
    x, y, width, height = rectangle
    rows, columns = frame.pixels.shape[:2]
    left, top = max(x, frame.x0), max(y, frame.y0)
    right, bottom = min(x + width, frame.x0 + columns), min(y + height, frame.y0 + rows)
    if left >= right or top >= bottom:
        return None
    pixels = frame.pixels[top - frame.y0 : bottom - frame.y0, left - frame.x0 : right - frame.x0]
    return replace(frame, pixels=pixels, x0=left - x, y0=top - y)
