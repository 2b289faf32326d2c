"""Streams that every codec can hold, and how each is encoded and decoded, for the tests over all codecs."""

from __future__ import annotations

import numpy as np
from stream_cases import random_events

from evis.events import Events, Imu, Triggers
from evis.events.codecs.decoder import Decoder, decoder_for
from evis.events.codecs.encoder import Encoder, encoder_for

WIRE = ("evt2", "evt21", "evt21_legacy", "evt3", "evt4", "davis346", "dvxplorer", "dvxplorer_mini", "dvs128")
MESSAGES = ("libcaer", "libcaer_cmp", "mono", "trigger")
ALL = WIRE + MESSAGES
SIZES = {"davis346": (346, 260), "dvs128": (128, 128)}
CHANNELS = {
    "evt2": 32,
    "evt21": 32,
    "evt21_legacy": 32,
    "evt3": 16,
    "evt4": 32,
    "davis346": 2,
    "dvxplorer": 2,
    "dvs128": 1,
}
LOSSLESS_BACKWARD = ("evt2", "evt21", "evt21_legacy", "evt3", "evt4", "libcaer", "libcaer_cmp", "mono")
"""Codecs that hold steps back in time wherever they come."""


def stream(encoding: str, seed: int, n: int, *, start_us: int = 0, step_us: int = 40, triggers: int = 0) -> Events:
    """Random events (and triggers) within what the encoding can hold, with times in whole us."""
    width, height = SIZES.get(encoding, (640, 480))
    events = random_events(seed, n, start_us=start_us, step_us=step_us, triggers=max(triggers, 1))
    events.x %= width
    events.y %= height
    edges = events.triggers
    if encoding == "trigger":
        result = Events.empty()
        result.triggers = Triggers(np.sort(events.t), events.x.astype(np.uint8), events.p)
        return result
    if encoding not in LOSSLESS_BACKWARD:
        events.t = np.sort(events.t)
    channels = CHANNELS.get(encoding, 0)
    if not channels or not triggers:
        events.triggers = Triggers()
    elif encoding == "dvs128":
        events.triggers = Triggers(edges.t, np.zeros_like(edges.id), np.ones_like(edges.value))
    else:
        events.triggers = Triggers(edges.t, edges.id % channels, edges.value)
    if encoding == "dvxplorer_mini":
        events = events[np.lexsort((events.y, events.p, events.y >> 3, events.x, events.t))]
    return events


def samples(seed: int, times_us: np.ndarray) -> Imu:
    """Inertial samples such as a hand-held camera gives."""
    rng, n = np.random.default_rng(seed), len(times_us)
    return Imu(times_us * 1000, rng.normal(0, 9, (n, 3)), rng.normal(0, 3, (n, 3)), rng.uniform(20, 45, n))


def decoder(encoding: str, backend: str = "numpy") -> Decoder:
    """A decoder for the size of `stream`."""
    return decoder_for(encoding, *SIZES.get(encoding, (640, 480)), backend)


def encoder(encoding: str) -> Encoder:
    """A fresh encoder."""
    return encoder_for(encoding)


def transport(encoding: str, events: Events) -> list[tuple[int, bytes]]:
    """(time base, bytes): one stretch of words for a camera, messages for the others."""
    if encoding in MESSAGES:
        return encoder(encoding).encode_packets(events)
    return [(0, encoder(encoding).encode(events))]
