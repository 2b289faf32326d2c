"""Wrong types, strangers, hostile frames and headers: refused or counted, and never a crash."""

from __future__ import annotations

import os

import msgpack
import numpy as np
import pytest
import zmq
from bus_workers import TOPIC, image, publisher_on, subscriber_on, wait_for

from evis.bus import END, BusError, PeerLost
from evis.bus.consumers import MAX_KEYS
from evis.bus.wire import Malformed, unpack_map
from msgs.camera import Depth, Motion
from msgs.codec import encode
from msgs.header import Header


def test_a_type_mismatch_names_both_sides_on_both_sides(context, endpoints):
    publisher = publisher_on(context, endpoints, ["labeler:in"])
    subscriber = subscriber_on(context, endpoints, kind=Motion)
    both = r"/cam0/depth.*renderer publishes Depth v1.*labeler:in expects Motion v1"
    with pytest.raises(BusError, match=both):
        wait_for(publisher.pump)
    with pytest.raises(BusError, match=both):
        wait_for(subscriber.connected)
    tap = subscriber_on(context, endpoints, "viewer", Motion, tap=True)
    wait_for(lambda: (publisher.pump(), publisher._tap.listeners)[1])
    publisher._tap.send(encode(Depth(Header(0), depth=np.zeros((1, 2, 2), np.float32))))
    with pytest.raises(BusError, match=r"viewer:in: the sender publishes Depth, this side expects Motion"):
        tap.receive(60_000)
    for one in publisher, subscriber, tap:
        one.close()


def test_publishing_another_type_is_an_error(pair):
    with pytest.raises(BusError, match="declared Depth and published Motion"):
        pair[0].send(Motion(Header(0), motion=np.zeros((1, 2, 2, 2), np.float32)))


def test_undeclared_and_double_consumers_are_refused(context, endpoints, pair):
    publisher, _ = pair
    for name, reason in ("stranger", "not a declared consumer of renderer"), ("labeler", "connected already"):
        other = subscriber_on(context, endpoints, name)
        with pytest.raises(BusError, match=reason):
            wait_for(lambda other=other: (publisher.pump(), other.connected())[1])
        other.close()
    publisher.pump()  # the refused namesake's leaving is not the consumer's
    assert publisher.missing() == [] and publisher.stats()["rejected"] == 2


HOSTILE = [
    b"", b"\0", b"\1", b"H", b"R", b"E", b"C", b"H\xc1", b"H" + msgpack.packb([1]), b"H" + msgpack.packb({"id": 3}),
    b"H" + msgpack.packb({"id": "labeler:in", "token": "", "type": "Depth v1", "window": 0}), b"C" + b"\xff" * 8,
    b"F" + bytes(8), b"T" + bytes(8), b"Z" + bytes(8), b"R" + msgpack.packb({"shared": 1}), os.urandom(1000),
    bytes(70_000), b"H" + b"\x91" * 1000 + b"\xc0", b"R" + b"\x81\xa1a" * 1000 + b"\xc0",
]  # fmt: skip


@pytest.mark.parametrize("nested", [b"\x91" * 1000 + b"\xc0", b"\x81\xa1a" * 1000 + b"\xc0"], ids=["lists", "maps"])
def test_what_is_nested_deeper_than_python_prints_is_malformed(nested):
    with pytest.raises(Malformed, match="no map with id, window"):
        unpack_map(b"H" + nested, id=str, window=int)


def passes_whole(publisher, subscriber, count):
    """Every message arrives as it was sent."""
    for i in range(count):
        slot = publisher.send(Depth(Header(i), depth=image(i)), timeout_s=60)
        if slot is not None:
            slot.unpin()
        message = subscriber.receive(60_000)
        assert message.header.stamp_ns == i and np.array_equal(message.depth, image(i))
        message.release()


def test_hostile_frames_are_counted_and_harm_nothing(context, endpoints, pair):
    publisher, subscriber = pair
    attackers = []
    for address in endpoints:
        for kind in (zmq.DEALER,) if address == endpoints.credit else (zmq.XSUB,):
            for _ in range(2):
                attackers.append(context.socket(kind))
                attackers[-1].connect(address)
    for attacker in attackers:
        for frame in HOSTILE:
            attacker.send(frame)
        attacker.send_multipart([b"C", b"C", b"C"])
    wait_for(lambda: (publisher.pump(), publisher.stats()["rejected"] >= 50)[1])
    for attacker in attackers:
        attacker.close(linger=0)
    passes_whole(publisher, subscriber, 50)
    assert subscriber.rejected == subscriber.lost == 0


@pytest.mark.parametrize("flood", ["frames", "subscriptions"])
def test_a_flood_harms_nothing(context, endpoints, pair, flood):
    """Of frames in one message, of subscriptions on one connection: what is sent before, amid and after it arrives."""
    publisher, subscriber = pair
    attackers = []
    for address in endpoints:
        attackers.append(context.socket(zmq.DEALER if address == endpoints.credit else zmq.XSUB))
        attackers[-1].connect(address)
        if flood == "frames":
            attackers[-1].send_multipart([b"\1"] * 20_000)
        else:
            for i in range(20_000):
                attackers[-1].send(b"\1!" + i.to_bytes(4, "little"))
    rejected = 20_000 if flood == "subscriptions" else 3
    passes_whole(publisher, subscriber, 200)
    wait_for(lambda: (publisher.pump(), publisher.stats()["rejected"] >= rejected)[1])
    assert len(publisher._consumers._keys) <= MAX_KEYS and publisher.missing() == []
    for attacker in attackers:
        attacker.close(linger=0)
    assert publisher.finish(0) is False and subscriber.receive(60_000) is END and publisher.finish(60)


def test_a_consumer_cannot_return_a_credit_twice(pair):
    publisher, subscriber = pair
    publisher.send(Depth(Header(0), depth=np.zeros((1, 2, 2), np.float32)))
    subscriber.receive(60_000).release()
    subscriber.reply(b"C", 0)
    wait_for(lambda: (publisher.pump(), publisher.stats()["rejected"] == 1)[1])
    assert publisher.credit() == 2


def hostile_headers():
    good = msgpack.unpackb(encode(Depth(Header(0), depth=np.zeros((1, 100, 100), np.float32)))[0])
    with open("/dev/null") as device:
        for slot in (
            5, [], ["cuda", 1, 2, 3, 4, 5, [0]], ["memfd", "1", 2, 3, 4, 5, [0]], ["memfd", 1, 2, 3, 4, 5, 6],
            ["memfd", 1, 2, 3, 4, 5, [0, 0]], ["memfd", 1, 2, 3, 4, 5, [-8]], ["memfd", 1, 2, 3, 4, 5, [1 << 40]],
        ):  # fmt: skip
            yield msgpack.packb({**good, "extra": {"slot": slot}}), BusError
        lying = ["memfd", os.getpid(), device.fileno(), 1, 0, 40_000, [0]]
        yield msgpack.packb({**good, "extra": {"slot": lying}}), PeerLost
    yield b"\xc1", BusError
    yield msgpack.packb({**good, "version": 9}), BusError


def test_hostile_headers_from_a_publisher_raise_and_do_not_crash(pair):
    publisher, subscriber = pair
    for header, error in hostile_headers():
        publisher._data.send_multipart([TOPIC.encode(), header])
        with pytest.raises(error, match="/cam0/depth"):
            subscriber.receive(60_000)


def test_a_slot_that_could_shrink_or_is_too_short_is_not_read(pair):
    """Reading pages that a peer took away would be a SIGBUS."""
    publisher, subscriber = pair
    good = msgpack.unpackb(encode(Depth(Header(0), depth=np.zeros((1, 100, 100), np.float32)))[0])
    unsealed = os.memfd_create("unsealed")
    os.ftruncate(unsealed, 40_000)
    for size, error in (40_000, PeerLost), (50_000, PeerLost):
        slot = ["memfd", os.getpid(), unsealed, 1, 0, size, [0]]
        publisher._data.send_multipart([TOPIC.encode(), msgpack.packb({**good, "extra": {"slot": slot}})])
        with pytest.raises(error):
            subscriber.receive(60_000)
    os.close(unsealed)
    ours = publisher._pool.take(1000)
    slot = ["memfd", os.getpid(), ours.fd, 2, 0, ours.size + 4096, [0]]
    publisher._data.send_multipart([TOPIC.encode(), msgpack.packb({**good, "extra": {"slot": slot}})])
    with pytest.raises(BusError, match="announced"):
        subscriber.receive(60_000)
    ours.unpin()


def test_a_tap_counts_garbage_and_goes_on(context, endpoints):
    publisher = publisher_on(context, endpoints, [])
    tap = subscriber_on(context, endpoints, "viewer", tap=True)
    wait_for(lambda: (publisher.pump(), publisher._tap.listeners)[1])
    for count, garbage in enumerate(([], [b"\xc1"], [b""], [b"x", b"y", b"z"]), 1):
        publisher.pump()
        publisher._tap.send(garbage)
        wait_for(lambda count=count: (tap.receive(), tap.rejected == count)[1])
    publisher.send(Depth(Header(3), depth=np.zeros((1, 2, 2), np.float32)))
    assert tap.receive(60_000).header.stamp_ns == 3
    tap.close()
    publisher.close()
