"""Decodes and encodes the `trigger` payload of event_camera_msgs: 8 bytes an edge, laid out as `mono` with the channel
in place of y."""

from __future__ import annotations

import numpy as np

from evis.events.arrays import Events, Triggers
from evis.events.codecs.event_camera_msgs import mono
from evis.events.codecs.event_camera_msgs import payload as ecm


class Decoder(ecm.RecordDecoder):
    """Decodes `trigger` messages to triggers; channels above 255 are dropped and counted as unknown."""

    encoding = "trigger"
    state_size = 5
    counters = {**ecm.Decoder.counters, "unknown": 4}

    def _times(self, words: np.ndarray) -> np.ndarray:
        return mono.times(words, int(self.state[ecm.BASE]))

    def _records(self, words: np.ndarray, t: np.ndarray) -> Events:
        events = Events.empty()
        channel = (words >> np.uint64(48) & np.uint64(0x7FFF)).astype(np.int64)
        known = channel < 256
        self.state[4] += np.count_nonzero(~known)
        value = (words >> np.uint64(63)).astype(np.uint8)
        events.triggers = Triggers(t[known], channel[known].astype(np.uint8), value[known])
        return events


class Encoder(ecm.Encoder):
    """Encodes triggers as `trigger` messages; events are refused."""

    encoding = "trigger"
    word = np.dtype("<u8")
    columns, rows, channels = 0, 0, 256
    span_ns = 1 << 32

    def _sequence(self, events: Events) -> np.ndarray:
        return events.triggers.t

    def _part(self, events: Events, part: slice) -> Events:
        edges, result = events.triggers, Events.empty()
        result.triggers = Triggers(edges.t[part], edges.id[part], edges.value[part])
        return result

    def _message(self, events: Events, base_ns: int) -> bytes:
        if len(events):
            raise ValueError("trigger messages hold triggers alone, no events")
        edges = events.triggers
        words = self._fit(edges.t, base_ns).astype(self.word)
        words |= edges.id.astype(self.word) << np.uint64(48) | edges.value.astype(self.word) << np.uint64(63)
        return words.tobytes()
