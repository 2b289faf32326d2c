"""Events as pictures on white, ON blue, OFF orange: those of a window, or all of them fading with their age."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from evis.events.arrays import Events
from evis.events.pixel_limit import check_pixels
from evis.events.recording import Recording

WHITE = (255, 255, 255)
ON = (24, 84, 196)
OFF = (217, 95, 2)
"""Blue and orange: equally dark on white, and different for colour-blind readers."""


def draw(events: Events, width: int, height: int) -> np.ndarray:
    """uint8 [height, width, 3]. Events outside the picture are left out."""
    picture = np.full((height, width, 3), WHITE, np.uint8)
    inside = (events.x < width) & (events.y < height)
    # where a pixel has several events numpy keeps the last assignment
    colours = np.array([OFF, ON], np.uint8)
    picture[events.y[inside], events.x[inside]] = colours[events.p[inside]]
    return picture


class TimeSurface:
    """The last event of each pixel, fading as exp(-age / tau)."""

    LEVELS = 24
    """Shades of a colour; few enough for the palette of a GIF."""

    def __init__(self, width: int, height: int, tau_ns: int) -> None:
        check_pixels(width, height)
        self._tau = tau_ns
        self._last = np.zeros((height, width), np.int64)
        self._row = np.zeros((height, width), np.uint8)
        shares = np.linspace(0, 1, self.LEVELS + 1)[None, :, None]
        colours = np.array([WHITE, OFF, ON], float)[:, None, :]
        self._shades = np.round(colours * shares + np.array(WHITE, float) * (1 - shares)).astype(np.uint8)

    def draw(self, events: Events, now_ns: int) -> np.ndarray:
        """uint8 [height, width, 3] at a time, with these events added. Events outside the picture are left out."""
        height, width = self._last.shape
        inside = (events.x < width) & (events.y < height)
        x, y = events.x[inside], events.y[inside]
        self._last[y, x], self._row[y, x] = events.t[inside], events.p[inside] + 1
        age = np.maximum(now_ns - self._last, 0)
        level = np.round(self.LEVELS * np.exp(age / -float(self._tau))).astype(np.intp)
        return self._shades[self._row, level]


def windows(recording: Recording, dt_ns: int, from_ns: int, to_ns: int | None) -> Iterator[tuple[int, Events]]:
    """(start, events) of consecutive windows of dt_ns from from_ns to to_ns, [ns] after the first event or trigger."""
    first = recording.next_t_ns
    if first is None:
        return
    start = first + from_ns
    if from_ns:
        recording.seek(start)
    end = None if to_ns is None else first + to_ns
    while recording.next_t_ns is not None and (end is None or start < end):
        stop = start + dt_ns if end is None else min(start + dt_ns, end)
        yield start - first, recording.read_until(stop - 1)
        start = stop
