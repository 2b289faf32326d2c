"""Events as pictures on white: the last event of each pixel in a window, ON blue, OFF orange."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from evis.streams.events import Events
from evis.streams.recording import Recording

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


def windows(recording: Recording, dt_ns: int, from_ns: int, to_ns: int | None) -> Iterator[tuple[int, Events]]:
    """(start, events) of consecutive windows of dt_ns from from_ns to to_ns, [ns] after the first event or trigger."""
    first = recording.next_t_ns
    if first is None:
        return
    start = first + from_ns
    recording.read_until(start - 1)
    end = None if to_ns is None else first + to_ns
    while recording.next_t_ns is not None and (end is None or start < end):
        stop = start + dt_ns if end is None else min(start + dt_ns, end)
        yield start - first, recording.read_until(stop - 1)
        start = stop
