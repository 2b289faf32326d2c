"""Latched topics for those who come late, and the end of a stream for those who only listen."""

from __future__ import annotations

import numpy as np
import pytest
import zmq
from bus_workers import meet, publisher_on, subscriber_on, wait_for

from evis.bus import END
from msgs.camera import CameraInfo, Depth
from msgs.header import Header


def info(width: int) -> CameraInfo:
    return CameraInfo(Header(0), k=np.eye(3), distortion=np.zeros(0), width=width)


def depth(stamp: int) -> Depth:
    return Depth(Header(stamp), depth=np.full((1, 3, 4), stamp, np.float32))


@pytest.mark.parametrize("tap", [False, True])
def test_a_late_joiner_gets_the_latched_value_once(context, endpoints, tap):
    publisher = publisher_on(context, endpoints, [] if tap else ["labeler:in"], CameraInfo, latched=True)
    publisher.send(info(1))
    publisher.send(info(2), timeout_s=1)  # does not wait for somebody who is not there yet
    late = subscriber_on(context, endpoints, kind=CameraInfo, tap=tap)
    wait_for(lambda: (publisher.pump(), late.connected(), late.socket.poll(0))[-1])
    message = late.receive()
    assert (message.width, message.header.seq) == (2, 1)
    message.release()
    publisher.send(info(3), timeout_s=60)
    assert late.receive(60_000).width == 3
    second = subscriber_on(context, endpoints, "viewer", CameraInfo, tap=True)
    wait_for(lambda: (publisher.pump(), second.socket.poll(0))[-1])
    assert second.receive().width == 3
    assert late.receive(50) is None and late.lost == 0  # newcomers do not repeat it for the others
    for one in publisher, late, second:
        one.close()


def test_a_latched_value_sent_while_a_consumer_connects_comes_once(context, endpoints):
    """Half connected, it gets the broadcast without having taken a credit, and then its own copy."""
    publisher = publisher_on(context, endpoints, ["labeler:in", "recorder:in"], CameraInfo, latched=True)
    first = subscriber_on(context, endpoints, "recorder", CameraInfo)
    wait_for(lambda: (publisher.pump(), first.connected(), publisher.missing() == ["labeler:in"])[-1])
    consumer = subscriber_on(context, endpoints, kind=CameraInfo)
    wait_for(lambda: (publisher.pump(), len(publisher._consumers._keys) == 2)[1])
    publisher.send(info(1))
    meet(publisher, consumer)
    received = []
    for width in (2, 3, 4, 5):
        message = consumer.receive(60_000)
        received.append(message.width)
        message.release()
        first.receive(60_000).release()
        publisher.send(info(width), timeout_s=60)
    assert [*received, consumer.receive(60_000).width] == [1, 2, 3, 4, 5]
    assert consumer.receive(100) is None
    first.receive(60_000).release()
    wait_for(lambda: (publisher.pump(), publisher.credit() == 1)[1])
    for one in publisher, consumer, first:
        one.close()


@pytest.mark.parametrize("read", [1, 0])
def test_a_tap_that_lags_behind_gets_the_newest_and_is_told_what_it_missed(read, context, endpoints, monkeypatch):
    """Whether it has read the first message or none yet. 30 more wait, more than the topic's queue of 2 and fewer than
    its socket holds.

    They are put into the queue of another socket as they come: so all are there, and none is on its way. The queue of
    the publisher, which would drop too, is longer here.
    """
    monkeypatch.setattr("evis.bus.publisher.queue_length", lambda topic: 64)
    publisher = publisher_on(context, endpoints, [], tap_hz=0)
    tap = subscriber_on(context, endpoints, "viewer", tap=True)
    wait_for(lambda: (publisher.pump(), publisher.wanted())[1])
    if read:
        publisher.send(depth(0), timeout_s=60)
        wait_for(lambda: (message := tap.receive(0)) is not None and message.header.stamp_ns == 0)
    waiting, come = context.socket(zmq.PAIR), tap._data
    tap._data = context.socket(zmq.PAIR)
    tap._data.bind("inproc://waiting")
    waiting.connect("inproc://waiting")
    for i in range(read, 31):
        publisher.send(depth(i), timeout_s=60)
        assert come.poll(60_000)
        waiting.send_multipart(come.recv_multipart())
    got = []
    while (message := tap.receive(100)) is not None:
        got.append(message.header.stamp_ns)
    assert got == [29, 30] and tap.lost == 29 - read
    for one in waiting, tap._data:
        one.close(linger=0)
    tap._data = come
    tap.close()
    publisher.close()


def test_the_end_reaches_taps_too(context, endpoints):
    publisher = publisher_on(context, endpoints, [])
    assert not publisher.wanted() and publisher.credit() > 1000
    tap = subscriber_on(context, endpoints, "viewer", tap=True)
    wait_for(lambda: (publisher.pump(), publisher.wanted())[1])
    assert publisher.finish(0)
    assert tap.receive(60_000) is END
    tap.close()
    wait_for(lambda: (publisher.pump(), not publisher.wanted())[1])
    publisher.close()
