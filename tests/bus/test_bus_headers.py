"""Headers that are sent once more with a new moment: what arrives is what was sent, and hostile ones are refused."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from bus_workers import TOPIC, meet, publisher_on, subscriber_on

from evis.bus import BusError
from msgs.camera import Depth, Labels
from msgs.codec import contents, pack_header
from msgs.header import Header


def test_a_header_sent_again_says_only_when(pair):
    """All that may change between messages of one slot arrives, whatever the one before was."""
    publisher, subscriber = pair
    image = np.arange(20_000, dtype=np.float32).reshape(1, 100, 200)
    sent = [(Header(i, clock="sim"), 0, image + i) for i in range(8)]
    sent += [
        (Header(9, clock="wall"), 0, image),
        (Header(-5, clock="wall", episode=1), 0, image),
        (Header(11), 3, image),
    ]
    sent += [(Header(12), 3, image.reshape(1, 200, 100)), (Header(13), 3, image)]
    for seq, (header, margin, depth) in enumerate(sent):
        publisher.send(Depth(header, depth=depth, margin=margin), timeout_s=60).unpin()
        message = subscriber.receive(60_000)
        assert message.header == Header(header.stamp_ns, seq, header.clock, header.episode)
        assert message.margin == margin and np.array_equal(message.depth, depth)
        message.depth.shape = (-1,)  # a consumer that does so spoils nothing but its own
        message.release()
    assert subscriber.lost == subscriber.rejected == 0


def test_received_lists_are_nobody_elses(context, endpoints):
    publisher = publisher_on(context, endpoints, ["labeler:in"], Labels)
    subscriber = subscriber_on(context, endpoints, kind=Labels)
    meet(publisher, subscriber)
    flow = np.ones((1, 100, 100, 2), np.float32)
    for i in range(8):
        publisher.send(Labels(Header(i), flow=flow * i, names=["ball"]), timeout_s=60).unpin()
        message = subscriber.receive(60_000)
        assert message.header.stamp_ns == i and message.names == ["ball"] and np.all(message.flow == i)
        message.names.append("mine")
        message.release()
    subscriber.close()
    publisher.close()


@pytest.mark.parametrize("moment", [b"", bytes(23), bytes(25), struct.pack("<qqq", 0, -1, 0)])
def test_hostile_moments_raise(pair, moment):
    publisher, subscriber = pair
    slot = publisher._pool.take(40_000)
    message = Depth(Header(0), depth=slot.place((1, 100, 100), np.dtype(np.float32)))
    header = pack_header(message, contents(message), {"slot": slot.descriptor([0])})
    for known in (False, True):
        if known:
            publisher._data.send_multipart([TOPIC.encode(), header])
            assert subscriber.receive(60_000).depth.shape == (1, 100, 100)
        publisher._data.send_multipart([TOPIC.encode(), header, moment])
        with pytest.raises(BusError, match="/cam0/depth"):
            subscriber.receive(60_000)
    slot.unpin()
