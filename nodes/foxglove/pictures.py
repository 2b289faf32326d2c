"""Draws what Foxglove cannot: events, and light without bounds."""

from __future__ import annotations

import time

import numpy as np

from evis.bag.preview import tone_map
from evis.bag.ros import images
from msgs.camera import EventPacket, Keyframe

EVENTS_HZ, PREVIEW_HZ = 30.0, 10.0
"""Most pictures a second of the wall's clock, of events and of keyframes."""
COLOURS = np.array([[255, 255, 255], [20, 90, 214], [214, 60, 20]], np.uint8)
"""Of a pixel without an event, whose newest is OFF, and ON."""
MOST_PIXELS = 1 << 24
"""Largest picture: a recording can say what it likes."""


class Pace:
    """Lets pass what comes no faster than `hz` of the wall's clock."""

    def __init__(self, hz: float) -> None:
        self._period, self._next = 1 / hz, 0.0

    def due(self) -> bool:
        """Tells whether one may pass now."""
        return time.monotonic() >= self._next

    def passed(self) -> None:
        """Notes that one has passed."""
        self._next = time.monotonic() + self._period


class EventPicture:
    """Draws the newest event of each pixel, of all packets since the last picture."""

    def __init__(self) -> None:
        self.pace = Pace(EVENTS_HZ)
        self.stamp_ns = 0
        self._canvas = np.zeros((0, 0), np.uint8)
        """0 = no event, 1 = the newest is OFF, 2 = ON."""
        self._episode = -1
        self._news = False

    def add(self, packet: EventPacket, width: int, height: int) -> int:
        """Draws a packet of one environment on a sensor of that size, and returns how many of its events lie outside.

        Events of an earlier episode are forgotten. Raises ValueError where nothing can be drawn.
        """
        if packet.x is None or packet.y is None or packet.p is None:
            raise ValueError(f"its packets hold {packet.encoding or 'raw'} bytes that are not decoded in this graph")
        if not 0 < width * height <= MOST_PIXELS:
            raise ValueError(f"its sensor has {width} x {height} pixels")
        if self._canvas.shape != (height, width) or packet.header.episode != self._episode:
            self._canvas = np.zeros((height, width), np.uint8)
            self._episode = packet.header.episode
        x, y, value = np.asarray(packet.x), np.asarray(packet.y), np.minimum(packet.p, 1) + np.uint8(1)
        inside = (x < width) & (y < height)
        outside = len(x) - int(np.count_nonzero(inside))
        if outside:
            x, y, value = x[inside], y[inside], value[inside]
        self._canvas[y, x] = value  # numpy keeps the last one assigned
        self.stamp_ns, self._news = max(packet.header.stamp_ns, 0), True
        return outside

    def take(self, frame_id: str) -> bytes | None:
        """Returns the picture, sensor_msgs/Image in CDR, and begins the next; None where there is nothing new or it is
        not due.
        """
        if not self._news or not self.pace.due():
            return None
        picture = _packed(COLOURS[self._canvas], self.stamp_ns, frame_id)
        self._canvas[:] = 0
        self._news = False
        self.pace.passed()
        return picture


def preview(keyframe: Keyframe, frame_id: str) -> bytes:
    """Returns a tone-mapped picture of a keyframe of one environment, without its margin: sensor_msgs/Image in CDR."""
    m, image = keyframe.margin, np.asarray(keyframe.rgb[0])
    cropped = image[m : image.shape[0] - m, m : image.shape[1] - m]
    return _packed(tone_map(cropped), keyframe.header.stamp_ns, frame_id)


def _packed(rgb: np.ndarray, stamp_ns: int, frame_id: str) -> bytes:
    return b"".join(images.pack(rgb, "data", "rgb8", stamp_ns, frame_id))
