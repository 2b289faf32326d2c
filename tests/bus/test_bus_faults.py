"""Deaths, freezes, full memory: one clear error each, nothing left behind."""

from __future__ import annotations

import errno
import itertools
import os
import signal
import time

import numpy as np
import pytest
from bus_workers import (
    QUICK_HEARTBEATS,
    TOPIC,
    image,
    lag,
    meet,
    publish,
    publisher_on,
    send_stream,
    subscriber_on,
    wait_for,
)

from evis.bus import END, BusError, PeerLost, wire
from evis.supervisor.silence import SILENCE_S
from msgs.camera import Depth
from msgs.header import Header


@pytest.fixture
def no_heartbeats(monkeypatch):
    """What is noticed without them is noticed at once."""
    monkeypatch.setattr(wire, "HEARTBEAT_MS", 0)


def assert_named(publisher):
    """The publisher waits for credit, as it does in a run, and learns whom it waits for in vain."""
    with pytest.raises(PeerLost, match=r"labeler:in .*/cam0/depth") as caught:
        while True:
            publisher.send(Depth(Header(0), depth=np.zeros((1, 2, 2), np.float32)), timeout_s=60)
    assert (caught.value.node, caught.value.topic) == ("labeler:in", TOPIC)
    publisher.close()


def test_a_dead_consumer_is_named_at_once(context, endpoints, reader, no_heartbeats):
    child = reader(endpoints, "labeler")
    publisher = publisher_on(context, endpoints, ["labeler:in"])
    wait_for(lambda: not publisher.missing())
    os.kill(child.process.pid, signal.SIGKILL)
    assert_named(publisher)


def test_a_frozen_consumer_is_named(context, endpoints, reader):
    """By its neighbours, before the supervisor ends it as silent; and one that was held for 2 s is not frozen."""
    assert wire.HEARTBEAT_MS + wire.HEARTBEAT_TIMEOUT_MS < 1000 * SILENCE_S
    child = reader(endpoints, "labeler")
    publisher = publisher_on(context, endpoints, ["labeler:in"])
    wait_for(lambda: not publisher.missing())
    os.kill(child.process.pid, signal.SIGSTOP)
    time.sleep(2)
    os.kill(child.process.pid, signal.SIGCONT)
    send_stream(publisher, 10)
    os.kill(child.process.pid, signal.SIGSTOP)
    assert_named(publisher)


def test_a_tap_that_is_not_read_for_long_is_read_again(context, endpoints, child, monkeypatch):
    """Heartbeats lay unread behind its full queue, the connection was made anew, and that ended its process."""
    for name, value in zip(("HEARTBEAT_MS", "HEARTBEAT_TIMEOUT_MS"), QUICK_HEARTBEATS):
        monkeypatch.setattr(wire, name, value)
    publisher = publisher_on(context, endpoints, [])
    reader = child(lag, endpoints)
    wait_for(lambda: (publisher.pump(), publisher._tap.eager)[1])
    numbers = itertools.count()

    def send() -> None:
        publisher.send(Depth(Header(next(numbers)), depth=np.zeros((1, 100, 100), np.float32)))
        publisher.pump()
        time.sleep(0.002)

    for _ in range(500):
        send()
    reader.pipe.send(500)
    wait_for(lambda: (send(), reader.pipe.poll())[1])
    assert reader.hear() is True
    publisher.close()


@pytest.mark.parametrize("ended", [False, True])
def test_a_tap_counts_what_a_publisher_that_is_started_again_sent_without_it(context, endpoints, ended):
    """It numbers its messages from 0: what came before 4 is lost whole, of the first publisher what is between two."""
    lost = []
    tap = subscriber_on(context, endpoints, tap=True, every=True)
    for numbers in ((0, 3, 9), (4, 5)):
        publisher = publisher_on(context, endpoints, [])
        # A socket subscribes anew where it is looked at.
        meet_tap(publisher, tap)
        for number in numbers:
            publisher.miss(number - publisher._seq)  # as if they had been sent, and none had come
            publisher.send(Depth(Header(number), depth=np.zeros((1, 2, 2), np.float32)))
            message = wait_for_message(tap)
            assert message.header.seq == number
            lost.append(tap.lost)
        if numbers[0] and ended:
            publisher.miss(3)
            publisher.finish(0)
            wait_for(lambda: tap.receive(5) is END, 20)
            lost.append(tap.lost)
        publisher.close()
    assert lost == [0, 2, 7, 11, 11, *([14] if ended else [])]
    tap.close()


def meet_tap(publisher, tap):
    wait_for(lambda: (tap.receive(0), publisher.pump(), publisher._tap.eager)[2], 20)


def wait_for_message(tap):
    found = []
    wait_for(lambda: found.append(tap.receive(5)) or found[-1] is not None, 20)
    return found[-1]


def test_a_killed_publisher_is_noticed_and_leaves_no_memory(context, endpoints, child, no_heartbeats):
    before = set(os.listdir("/dev/shm"))
    sender = child(publish, endpoints, ["labeler:in"], {"count": 2, "hang": True})
    subscriber = subscriber_on(context, endpoints)
    first, second = (subscriber.receive(60_000) for _ in range(2))
    assert first.header.stamp_ns == 0
    second.keep()
    first.release()
    second.release()
    os.kill(sender.hear(), signal.SIGKILL)
    with pytest.raises(PeerLost, match="renderer"):
        wait_for(lambda: subscriber.receive(20) or subscriber.raise_if_publisher_lost())
    wait_for(lambda: not set(os.listdir("/dev/shm")) - before)  # other programs come and go there
    assert np.array_equal(second.depth, image(1))  # the pages live as long as somebody looks at them
    second.release()
    subscriber.close()


def test_messages_sent_before_a_publisher_died_are_received_first(context, endpoints, child):
    sender = child(publish, endpoints, ["labeler:in"], {"count": 1, "hang": True})
    subscriber = subscriber_on(context, endpoints)
    wait_for(subscriber.connected)
    os.kill(sender.hear(), signal.SIGKILL)
    wait_for(lambda: subscriber._check_connection() or subscriber._disconnected)
    subscriber.raise_if_publisher_lost()  # not yet: there is something to read
    assert subscriber.receive(60_000).header.stamp_ns == 0
    with pytest.raises(PeerLost):
        wait_for(lambda: subscriber.raise_if_publisher_lost())
    subscriber.close()


def test_a_consumer_that_leaves_early_is_lost_and_may_come_back(context, endpoints, pair):
    publisher, subscriber = pair
    subscriber.close()
    with pytest.raises(PeerLost):
        wait_for(publisher.pump)
    assert publisher.missing() == ["labeler:in"]
    again = subscriber_on(context, endpoints)
    meet(publisher, again)
    publisher.send(Depth(Header(7), depth=np.zeros((1, 2, 2), np.float32)))
    assert again.receive(60_000).header.stamp_ns == 7
    again.close()


def test_a_consumer_that_dies_during_the_end_is_named(context, endpoints, reader):
    child = reader(endpoints, "labeler", hang_after=1)
    publisher = publisher_on(context, endpoints, ["labeler:in"])
    wait_for(lambda: not publisher.missing())
    send_stream(publisher, 1)
    assert child.hear() == "hanging"
    assert publisher.finish(0.05) is False
    child.process.kill()
    with pytest.raises(PeerLost, match="labeler:in"):
        publisher.finish(60)
    publisher.close()


def test_waiting_for_credit_ends_with_the_names(pair):
    publisher, _ = pair
    for i in range(2):
        publisher.send(Depth(Header(i), depth=np.zeros((1, 2, 2), np.float32)))
    with pytest.raises(BusError, match="no credit from labeler:in"):
        publisher.send(Depth(Header(2), depth=np.zeros((1, 2, 2), np.float32)), timeout_s=0.05)
    assert publisher.stats()["waits_s"] >= 0.05


def test_full_memory_is_one_clear_error(pair, monkeypatch):
    publisher, _ = pair

    def full(fd, offset, size):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(BusError, match=r"no room for .* MB of shared memory for /cam0/depth \(No space left"):
        publisher.loan(depth=((1, 500, 500), "float32"))


def test_memory_is_reserved_before_it_is_written(pair):
    """A sparse file would be a SIGBUS at the first write where memory is short."""
    publisher, _ = pair
    publisher.loan(depth=((1, 500, 500), "float32"))
    slot = publisher._pool._loans[0]
    assert os.fstat(slot.fd).st_blocks * 512 >= 1_000_000


def test_messages_kept_for_ever_end_in_an_error_that_says_so(pair):
    publisher, subscriber = pair
    depth = np.zeros((1, 100, 100), np.float32)
    kept = []
    with pytest.raises(BusError, match="keep"):
        for i in range(200):
            publisher.send(Depth(Header(i), depth=depth)).unpin()
            message = subscriber.receive(60_000)
            message.keep()
            message.release()
            kept.append(message)
    assert len(kept) == 64
    for message in kept:
        message.release()
    wait_for(lambda: (publisher.pump(), len(publisher._pool._free) == 64)[1])
    publisher.send(Depth(Header(0), depth=depth)).unpin()  # and goes on when they are released
    assert subscriber.receive(60_000) is not None


def test_one_release_too_many_is_an_error(pair):
    publisher, subscriber = pair
    publisher.send(Depth(Header(0), depth=np.zeros((1, 100, 100), np.float32))).unpin()
    message = subscriber.receive(60_000)
    message.release()
    with pytest.raises(BusError, match="released more often"):
        message.release()
    with pytest.raises(BusError, match="after its release"):
        message.keep()


def test_received_arrays_cannot_be_written(pair):
    publisher, subscriber = pair
    for side in (2, 200):
        publisher.send(Depth(Header(0), depth=np.zeros((1, side, side), np.float32)))
        with pytest.raises(ValueError, match="read-only"):
            subscriber.receive(60_000).depth[...] = 1


def test_a_message_from_the_bus_is_not_published_again(pair):
    publisher, subscriber = pair
    publisher.send(Depth(Header(0), depth=np.zeros((1, 2, 2), np.float32)))
    with pytest.raises(BusError, match="make a new one"):
        publisher.send(subscriber.receive(60_000))
