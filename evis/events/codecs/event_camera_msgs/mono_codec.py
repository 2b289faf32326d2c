"""Decodes and encodes the `mono` payload of event_camera_msgs: 8 bytes an event, exact to the nanosecond.

Bit 63 polarity, bits 48-62 y, bits 32-47 x, bits 0-31 ns since the message's time base.
"""

from __future__ import annotations

import numpy as np

from evis.events.arrays import Events
from evis.events.codecs.event_camera_msgs import mono
from evis.events.codecs.event_camera_msgs import payload as ecm


class Decoder(ecm.RecordDecoder):
    """Decodes `mono` messages to events."""

    encoding = "mono"

    def _times(self, words: np.ndarray) -> np.ndarray:
        return mono.times(words, int(self.state[ecm.BASE]))

    def _records(self, words: np.ndarray, t: np.ndarray) -> Events:
        _, x, y, p = mono.unpack(words, 0)
        return self._inside(Events(t, x, y, p))


class Encoder(ecm.Encoder):
    """Encodes events as `mono` messages."""

    encoding = "mono"
    word = np.dtype("<u8")
    columns, rows, channels = 1 << 16, mono.MAX_Y + 1, 0
    span_ns = mono.SPAN_NS

    def _message(self, events: Events, base_ns: int) -> bytes:
        self._fit(events.t, base_ns)
        return mono.pack(events.t, events.x, events.y, events.p, base_ns).tobytes()
