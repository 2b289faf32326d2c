"""Deaths, freezes, full memory, hostile frames, wrong types: one clear error each, nothing left behind."""

from __future__ import annotations

import errno
import os
import signal
import time
from pathlib import Path

import msgpack
import numpy as np
import pytest
import zmq
from bus_workers import TOPIC, image, loopback, publish, publisher_on, send_stream, truth, wait_for

from evis.bus import END, BusError, PeerLost, Subscriber, endpoints_for, tcp_endpoints
from msgs.camera import CameraInfo, Depth, Motion
from msgs.codec import encode
from msgs.header import Header


def subscriber_on(context, endpoints, name="labeler", kind=Depth, **options):
    subscriber = Subscriber(context, TOPIC, name, "in", endpoints, message_type=kind, **options)
    subscriber.start()
    return subscriber


def meet(publisher, *subscribers):
    wait_for(lambda: (publisher.pump(), all([s.connected() for s in subscribers]))[1] and not publisher.missing())


@pytest.fixture
def pair(context, endpoints):
    """A publisher and one consumer, in this process, connected."""
    publisher = publisher_on(context, endpoints, ["labeler:in"])
    subscriber = subscriber_on(context, endpoints)
    meet(publisher, subscriber)
    yield publisher, subscriber
    subscriber.close()
    publisher.close()


# -- deaths ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("signal_number", "within_s"), [(signal.SIGKILL, 1.0), (signal.SIGSTOP, 2.0)])
def test_a_dead_or_frozen_consumer_is_named(context, endpoints, reader, signal_number, within_s):
    child = reader(endpoints, "labeler")
    publisher = publisher_on(context, endpoints, ["labeler:in"])
    wait_for(lambda: not publisher.missing())
    os.kill(child.process.pid, signal_number)
    start = time.monotonic()
    with pytest.raises(PeerLost, match=r"labeler:in .*/cam0/depth") as caught:
        while time.monotonic() - start < 10:  # the publisher waits for credit, as it does in a run
            publisher.send(Depth(Header(0), depth=np.zeros((1, 2, 2), np.float32)), timeout_s=5)
    assert (caught.value.node, caught.value.topic) == ("labeler:in", TOPIC)
    assert time.monotonic() - start < within_s
    publisher.close()


def test_a_killed_publisher_is_noticed_and_leaves_no_memory(context, endpoints, child):
    before = set(os.listdir("/dev/shm"))
    sender = child(publish, endpoints, ["labeler:in"], {"count": 2, "hang": True})
    subscriber = subscriber_on(context, endpoints)
    first, second = (subscriber.receive(20_000) for _ in range(2))
    assert first.header.stamp_ns == 0
    second.keep()
    first.release()
    second.release()
    os.kill(sender.hear(), signal.SIGKILL)
    start = time.monotonic()
    with pytest.raises(PeerLost, match="renderer"):
        while time.monotonic() - start < 10:
            assert subscriber.receive(20) is None
            subscriber.raise_if_publisher_lost()
    assert time.monotonic() - start < 1.0
    assert set(os.listdir("/dev/shm")) - before == set()
    assert np.array_equal(second.depth, image(1))  # the pages live as long as somebody looks at them
    second.release()
    subscriber.close()


def test_messages_sent_before_a_publisher_died_are_received_first(context, endpoints, child):
    sender = child(publish, endpoints, ["labeler:in"], {"count": 1, "hang": True})
    subscriber = subscriber_on(context, endpoints)
    wait_for(subscriber.connected)
    os.kill(sender.hear(), signal.SIGKILL)
    time.sleep(0.1)
    subscriber.raise_if_publisher_lost()  # not yet: there is something to read
    assert subscriber.receive(1000).header.stamp_ns == 0
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
    assert again.receive(5000).header.stamp_ns == 7
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
        publisher.finish(10)
    publisher.close()


def test_waiting_for_credit_ends_with_the_names(pair):
    publisher, _ = pair
    for i in range(2):
        publisher.send(Depth(Header(i), depth=np.zeros((1, 2, 2), np.float32)))
    with pytest.raises(BusError, match="no credit from labeler:in"):
        publisher.send(Depth(Header(2), depth=np.zeros((1, 2, 2), np.float32)), timeout_s=0.05)
    assert publisher.stats()["waits_s"] >= 0.05


# -- memory ----------------------------------------------------------------------------------------------------------


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
            message = subscriber.receive(5000)
            message.keep()
            message.release()
            kept.append(message)
    assert len(kept) == 64
    for message in kept:
        message.release()
    wait_for(lambda: (publisher.pump(), len(publisher._pool._free) == 64)[1])
    publisher.send(Depth(Header(0), depth=depth)).unpin()  # and goes on when they are released
    assert subscriber.receive(5000) is not None


def test_one_release_too_many_is_an_error(pair):
    publisher, subscriber = pair
    publisher.send(Depth(Header(0), depth=np.zeros((1, 100, 100), np.float32))).unpin()
    message = subscriber.receive(5000)
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
            subscriber.receive(5000).depth[...] = 1


def test_a_message_from_the_bus_is_not_published_again(pair):
    publisher, subscriber = pair
    publisher.send(Depth(Header(0), depth=np.zeros((1, 2, 2), np.float32)))
    with pytest.raises(BusError, match="make a new one"):
        publisher.send(subscriber.receive(5000))


# -- types and hostile frames ----------------------------------------------------------------------------------------


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
        tap.receive(5000)
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
    bytes(70_000),
]  # fmt: skip


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
    for i in range(50):
        slot = publisher.send(Depth(Header(i), depth=image(i)), timeout_s=5)
        if slot is not None:
            slot.unpin()
        message = subscriber.receive(5000)
        assert message.header.stamp_ns == i and np.array_equal(message.depth, image(i))
        message.release()
    assert subscriber.rejected == subscriber.lost == 0


def test_a_consumer_cannot_return_a_credit_twice(pair):
    publisher, subscriber = pair
    publisher.send(Depth(Header(0), depth=np.zeros((1, 2, 2), np.float32)))
    subscriber.receive(5000).release()
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
            subscriber.receive(5000)


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
            subscriber.receive(5000)
    os.close(unsealed)
    ours = publisher._pool.take(1000)
    slot = ["memfd", os.getpid(), ours.fd, 2, 0, ours.size + 4096, [0]]
    publisher._data.send_multipart([TOPIC.encode(), msgpack.packb({**good, "extra": {"slot": slot}})])
    with pytest.raises(BusError, match="announced"):
        subscriber.receive(5000)
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
    assert tap.receive(5000).header.stamp_ns == 3
    tap.close()
    publisher.close()


# -- latched topics and the end --------------------------------------------------------------------------------------


def info(width: int) -> CameraInfo:
    return CameraInfo(Header(0), k=np.eye(3), distortion=np.zeros(0), width=width)


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
    publisher.send(info(3), timeout_s=5)
    assert late.receive(5000).width == 3
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
        while (message := consumer.receive(100)) is not None:
            received.append(message.width)
            message.release()
        first.receive(5000).release()
        publisher.send(info(width), timeout_s=5)
    assert [*received, consumer.receive(5000).width] == [1, 2, 3, 4, 5]
    first.receive(5000).release()
    wait_for(lambda: (publisher.pump(), publisher.credit() == 1)[1])
    for one in publisher, consumer, first:
        one.close()


def test_the_end_reaches_taps_too(context, endpoints):
    publisher = publisher_on(context, endpoints, [])
    assert not publisher.wanted() and publisher.credit() > 1000
    tap = subscriber_on(context, endpoints, "viewer", tap=True)
    wait_for(lambda: (publisher.pump(), publisher.wanted())[1])
    assert publisher.finish(0)
    assert tap.receive(5000) is END
    tap.close()
    wait_for(lambda: (publisher.pump(), not publisher.wanted())[1])
    publisher.close()


# -- endpoints -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("host", ["*", "0.0.0.0", "192.168.1.5", "eth0", "example.org", "[::]"])
def test_an_unkeyed_bind_beyond_loopback_is_refused(context, host):
    with pytest.raises(BusError, match="could be reached from other machines: give CURVE keys"):
        publisher_on(context, tcp_endpoints(host, 5555), [])


def test_an_open_directory_a_long_path_and_a_second_publisher_are_refused(context, endpoints, tmp_path):
    long = tmp_path / ("x" * 100)
    with pytest.raises(BusError, match="shorter run directory"):
        endpoints_for(long, TOPIC)
    shared = Path("/tmp").stat().st_mode & 0o077
    assert shared
    with pytest.raises(BusError, match="0700"):
        publisher_on(context, endpoints_for("/tmp", TOPIC), [])
    first = publisher_on(context, endpoints, [])
    with pytest.raises(BusError, match="already publishes this topic"):
        publisher_on(context, endpoints, [])
    first.close()
    assert not any(os.path.exists(a.removeprefix("ipc://")) for a in endpoints)


def test_topics_never_share_a_socket():
    names = {endpoints_for("/run", t).lockstep for t in ("/a/b", "/a.b", "/a-b", "/a_b", "/ab", "/a/b.tap")}
    assert len(names) == 6


def test_curve_keys_open_tcp_and_strangers_stay_out(context, reader):
    public, secret = (key.decode() for key in zmq.curve_keypair())
    publisher = publisher_on(context, tcp_endpoints("0.0.0.0", 0, public), ["labeler:in"], secret_key=secret)
    lockstep, credit, tap = (a.replace("0.0.0.0", "127.0.0.1") for a in publisher.endpoints)
    keyed = type(publisher.endpoints)(lockstep, credit, tap, public)
    stranger = subscriber_on(context, type(keyed)(lockstep, credit, tap), "labeler")
    wrong = subscriber_on(context, type(keyed)(lockstep, credit, tap, zmq.curve_keypair()[0].decode()), "labeler")
    time.sleep(0.2)
    assert publisher.missing() == ["labeler:in"] and not stranger.connected() and not wrong.connected()
    child = reader(keyed, "labeler")
    wait_for(lambda: not publisher.missing())
    send_stream(publisher, 20)
    assert publisher.finish(10)
    assert child.hear()["hash"] == truth(20)
    for one in publisher, stranger, wrong:
        one.close()


def test_loopback_tcp_needs_no_keys(context):
    publisher = publisher_on(context, loopback(), [])
    assert all(a.startswith("tcp://127.0.0.1:") for a in publisher.endpoints)
    publisher.close()
