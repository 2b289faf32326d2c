"""Draws events as pictures: the last of each pixel in a window, or all of them fading with their age."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from evis.events.arrays import Events
from evis.events.pixel_limit import check_pixels
from evis.events.recording import Recording
from evis.events.stretches import Stretches


class Colours(NamedTuple):
    """Holds the sRGB colours of a picture of events.

    ON and OFF are equally light and differ for colour-blind readers too.
    """

    ground: tuple[int, int, int]
    on: tuple[int, int, int]
    off: tuple[int, int, int]


ON_WHITE = Colours((255, 255, 255), (24, 84, 196), (217, 95, 2))
"""For paper: ON blue, OFF orange."""
ON_BLACK = Colours((10, 12, 16), (255, 173, 77), (85, 168, 255))
"""For screens, as on the live page: ON warm, OFF cool."""


def draw(events: Events, width: int, height: int) -> np.ndarray:
    """Draws the last event of each pixel on white, uint8 [height, width, 3]; those outside are left out."""
    picture = np.full((height, width, 3), ON_WHITE.ground, np.uint8)
    inside = (events.x < width) & (events.y < height)
    # where a pixel has several events numpy keeps the last assignment
    colours = np.array([ON_WHITE.off, ON_WHITE.on], np.uint8)
    picture[events.y[inside], events.x[inside]] = colours[events.p[inside]]
    return picture


def faded_events(
    t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray, width: int, height: int, at_ns: int, tau_ns: int
) -> np.ndarray:
    """Draws the newest event of each pixel until `at_ns` on black, faded by exp(-(at - t) / tau), uint8 [H, W, 3].

    t: int64 [n] ns, ascending; x, y: [n] pixels, those outside the picture are left out; p: [n], 1 = ON.
    """
    first, last = np.searchsorted(t, [at_ns - 5 * tau_ns, at_ns], side="right")
    t, x, y, p = t[first:last], x[first:last], y[first:last], p[first:last]
    inside = (x < width) & (y < height)
    picture = np.empty((height, width, 3), np.float32)
    ground, on, off = (np.array(colour, np.float32) for colour in ON_BLACK)
    picture[:] = ground
    strength = np.exp((t[inside] - at_ns) / tau_ns).astype(np.float32)[:, None]
    colour = np.where((p[inside] != 0)[:, None], on, off)
    # Where a pixel has several events numpy keeps the last one assigned, the newest.
    picture[y[inside], x[inside]] = ground + strength * (colour - ground)
    return np.round(picture).astype(np.uint8)


class TimeSurface:
    """Draws the last event of each pixel on white, fading as exp(-age / tau), of a stream that comes in pieces."""

    LEVELS = 24
    """Shades of a colour; few enough for the palette of a GIF."""

    def __init__(self, width: int, height: int, tau_ns: int) -> None:
        check_pixels(width, height)
        self._tau = tau_ns
        self._last = np.zeros((height, width), np.int64)
        self._row = np.zeros((height, width), np.uint8)
        shares = np.linspace(0, 1, self.LEVELS + 1)[None, :, None]
        colours = np.array([ON_WHITE.ground, ON_WHITE.off, ON_WHITE.on], float)[:, None, :]
        self._shades = np.round(colours * shares + np.array(ON_WHITE.ground, float) * (1 - shares)).astype(np.uint8)

    def draw(self, events: Events, now_ns: int) -> np.ndarray:
        """Returns uint8 [height, width, 3] at a time, with these events added. Events outside the picture are left
        out.
        """
        height, width = self._last.shape
        inside = (events.x < width) & (events.y < height)
        x, y = events.x[inside], events.y[inside]
        self._last[y, x], self._row[y, x] = events.t[inside], events.p[inside] + 1
        age = np.maximum(now_ns - self._last, 0)
        level = np.round(self.LEVELS * np.exp(age / -float(self._tau))).astype(np.intp)
        return self._shades[self._row, level]


def windows(recording: Recording, dt_ns: int, from_ns: int, to_ns: int | None) -> Iterator[tuple[int, Events]]:
    """Yields (start, events) of consecutive windows of dt_ns from from_ns to to_ns, [ns] after the first event or
    trigger.

    Where the times of a recording begin anew, as with an episode of a bag, they go on behind the last event: those of
    the events that are given too.
    """
    first = recording.next_t_ns
    if first is None:
        return
    start = first + from_ns
    if from_ns:
        recording.seek(start)
    end = None if to_ns is None else first + to_ns
    stretches, ahead = Stretches(), Events.empty()
    while (len(ahead) or recording.next_t_ns is not None) and (end is None or start < end):
        stop = start + dt_ns if end is None else min(start + dt_ns, end)
        cut = _first_from(ahead.t, stop)
        if cut == len(ahead):
            # What is read ends at a time of the stretch that it begins in, and may lie in later ones.
            read = recording.read_until(stop - stretches.shift_ns - 1)
            parts = [replace(read[part], t=t) for part, t, _ in stretches.parts(read.t)]
            ahead = Events.concatenate([ahead, *parts])
            cut = _first_from(ahead.t, stop)
        yield start - first, ahead[:cut]
        ahead, start = ahead[cut:], stop


def _first_from(t: np.ndarray, stop_ns: int) -> int:
    """Returns how many events come before the first one at or after a time: t int64 [n] ns."""
    later = t >= stop_ns
    return int(later.argmax()) if later.any() else len(t)
