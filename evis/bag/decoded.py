"""Reads the events of a bag's topic, decoded where they were recorded as a sensor's own bytes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from evis.bag import BagError
from evis.bag.reader import BagReader
from evis.files.damage import faults_as
from msgs.camera import EventPacket

if TYPE_CHECKING:
    from evis.events.arrays import Events
    from evis.events.codecs.decoder import Decoder


def decoded_events(reader: BagReader, topic: str, env: int | None = None) -> Iterator[tuple[EventPacket, Events]]:
    """Yields (packet, its events); one decoder decodes a sensor's own bytes and keeps its state between packets.

    env: the environment whose events to give, all of them when None. Raises BagError for an encoding that has no
    decoder here.
    """
    from evis.events.arrays import Events
    from evis.events.codecs.decoder import decoder_for

    decoder: Decoder | None = None
    for _, packet in reader.messages([topic]):
        if not isinstance(packet, EventPacket):
            raise BagError(f"{topic} holds {type(packet).__name__} messages, no events")
        if packet.t is not None and packet.x is not None and packet.y is not None and packet.p is not None:
            whole = Events(packet.t, packet.x, packet.y, packet.p, packet.c)
            yield packet, whole if env is None else whole[packet.env_offsets[env] : packet.env_offsets[env + 1]]
            continue
        try:
            decoder = decoder or decoder_for(packet.encoding, packet.width, packet.height)
        except ValueError as error:
            raise BagError(f"{topic}: {error}") from None
        raw = np.empty(0, np.uint8) if packet.raw is None else packet.raw
        with faults_as(BagError, reader.path):
            events = decoder.decode(raw.tobytes())
        yield packet, events
