"""The pipes between processes of one machine: order, room, garbage, and what happens where they cannot be used."""

from __future__ import annotations

import fcntl
import os
import struct
from contextlib import suppress

import numpy as np
import pytest
import zmq
from bus_workers import image, meet, publisher_on, send_stream, subscriber_on, truth, wait_for

from evis.bus import END, BusError, pipes
from evis.bus.wire import Malformed
from msgs.camera import Depth
from msgs.header import Header
from msgs.world import WorldState


def deliver(publisher, subscriber, i):
    slot = publisher.send(Depth(Header(i), depth=image(i)), timeout_s=60)
    if slot is not None:
        slot.unpin()
    message = subscriber.receive(60_000)
    assert message.header.stamp_ns == i and np.array_equal(message.depth, image(i))
    message.release()


def open_files():
    paths = (f"/proc/self/fd/{fd}" for fd in os.listdir("/proc/self/fd"))
    found = set()
    for path in paths:
        # ZeroMQ's own threads close theirs meanwhile.
        with suppress(FileNotFoundError):
            found.add(os.readlink(path))
    return found


def test_neighbours_use_pipes_and_nothing_stays_open(context, endpoints):
    publisher = publisher_on(context, endpoints, ["labeler:in"])
    subscriber = subscriber_on(context, endpoints)
    meet(publisher, subscriber)
    for i in range(20):
        deliver(publisher, subscriber, i)
        assert not subscriber.socket.poll(0)
    assert subscriber._piped and subscriber._credits is not None
    pipes_in_use = {f"pipe:[{inbox.address[2]}]" for inbox in (subscriber._inbox, publisher._consumers.inbox)}
    assert len(pipes_in_use & open_files()) == 2
    subscriber.close()
    publisher.close()
    assert not pipes_in_use & open_files()


@pytest.mark.parametrize("window", [1, 2, 16])
def test_messages_too_long_for_the_pipe_keep_their_place(context, endpoints, reader, window, monkeypatch):
    """Some go through the pipe and some over the socket; the order is that of the publisher."""
    monkeypatch.setattr(pipes, "PAGES_PER_MESSAGE", 1)  # of the sizes of the stream two fit, three are in slots
    child = reader(endpoints, "labeler", window=window)
    publisher = publisher_on(context, endpoints, ["labeler:in"], window=window)
    wait_for(lambda: not publisher.missing())
    publisher._consumers.all["labeler:in"].room = 250  # descriptors do not fit, the smallest images do
    send_stream(publisher, 200)
    assert publisher.finish(60)
    report = child.hear()
    assert report["hash"] == truth(200) and report["lost"] == report["rejected"] == 0
    publisher.close()


@pytest.mark.parametrize("window", [16, 34])
def test_a_window_of_the_longest_records_fits(context, endpoints, window):
    """What the publisher takes to have room must have it, whatever the fragmentation of pages; no pipe is larger than
    a user without privileges may make it."""
    inbox = pipes.MessageInbox(window)
    outlet = pipes.Outlet(inbox.address)
    assert fcntl.fcntl(inbox.fileno(), fcntl.F_GETPIPE_SZ) <= 1 << 20
    room = outlet.room(window)
    assert room >= pipes.PAGE
    for size in (room, room - 1, room // 2 + 1, 2049, 2047, 8):
        record = pipes.pack([bytes(size - 12)]) if size > 12 else pipes.ELSEWHERE
        assert len(record) == size
        assert all(outlet.write(record) for _ in range(window)) and outlet.write(pipes.ELSEWHERE)
        frames = [inbox.take() for _ in range(window + 1)]
        assert frames[:-1] == [[bytes(size - 12)] if size > 12 else []] * window and frames[-1] == []
        assert inbox.take() is None
    outlet.close()
    inbox.close()


def test_a_credit_that_finds_the_pipe_full_is_not_lost(pair):
    publisher, subscriber = pair
    publisher.send(Depth(Header(0), depth=np.zeros((1, 2, 2), np.float32)))
    publisher.send(Depth(Header(1), depth=np.zeros((1, 2, 2), np.float32)))
    first, second = subscriber.receive(60_000), subscriber.receive(60_000)
    first.release()
    stuffing = 0
    while subscriber._credits.write(bytes(16)):
        stuffing += 16
    second.release()
    wait_for(lambda: (publisher.pump(), publisher.credit() == 2)[1])
    assert stuffing - 16 < publisher.stats()["rejected"] <= stuffing  # byte by byte, and neither credit with it


@pytest.mark.parametrize(
    "garbage", [b"\0", b"\xa1$\x11\xfe\x9d_\x8f\xe0R\xda\x8b\xb5\x07", b"x" * 4000, struct.pack("<I4sQ", 0, b"C", 0)]
)
def test_garbage_in_the_credit_pipe_displaces_nobody(pair, garbage):
    publisher, subscriber = pair
    intruder = pipes.Outlet(publisher._consumers.inbox.address)
    for i in range(30):
        assert intruder.write(garbage)
        deliver(publisher, subscriber, i)
    intruder.write(garbage)
    wait_for(lambda: (publisher.pump(), publisher.stats()["rejected"] >= 30 * len(garbage))[1])
    wait_for(lambda: (publisher.pump(), publisher.credit() == 2)[1])
    intruder.close()


@pytest.mark.parametrize(("op", "seq"), [(b"C", 7), (b"C", 2**64 - 1), (b"T", 3), (b"F", 9), (b"Z", 0), (b"\0", 0)])
def test_a_wrong_credit_is_counted(pair, op, seq):
    publisher, subscriber = pair
    publisher.send(Depth(Header(0), depth=np.zeros((1, 2, 2), np.float32)))
    subscriber._credits.write_credit(subscriber._link, op, seq)
    wait_for(lambda: (publisher.pump(), publisher.stats()["rejected"] == 1)[1])
    assert publisher.credit() == 1
    subscriber.receive(60_000).release()
    wait_for(lambda: (publisher.pump(), publisher.credit() == 2)[1])


def test_credits_of_an_earlier_connection_do_not_count(context, endpoints, pair):
    publisher, subscriber = pair
    link = subscriber._link
    subscriber.close()
    with pytest.raises(BusError):
        wait_for(publisher.pump)
    again = subscriber_on(context, endpoints)
    meet(publisher, again)
    publisher.send(Depth(Header(0), depth=np.zeros((1, 2, 2), np.float32)))
    again._credits.write_credit(link, b"C", 0)
    wait_for(lambda: (publisher.pump(), publisher.stats()["rejected"] > 0)[1])
    assert publisher.credit() == 1
    again.close()


HOSTILE = [struct.pack("<II", 4, 0), struct.pack("<II", 1 << 31, 1), struct.pack("<III", 12, 1, 9), b"\xff" * 64]


@pytest.mark.parametrize("record", HOSTILE)
def test_what_is_no_record_is_an_error_and_no_crash(context, endpoints, record):
    inbox = pipes.MessageInbox(2)
    outlet = pipes.Outlet(inbox.address)
    assert outlet.write(record)
    with pytest.raises(Malformed):
        inbox.take()
    outlet.close()
    inbox.close()
    publisher = publisher_on(context, endpoints, ["labeler:in"])
    subscriber = subscriber_on(context, endpoints)
    meet(publisher, subscriber)
    assert publisher._consumers.all["labeler:in"].outlet.write(record)
    with pytest.raises(BusError, match=r"/cam0/depth: labeler:in cannot read what came through its pipe"):
        subscriber.receive(60_000)
    subscriber.close()
    publisher.close()


def test_a_record_in_pieces_is_put_together():
    inbox = pipes.MessageInbox(2)
    outlet = pipes.Outlet(inbox.address)
    frames = [b"header", bytes(9000), b""]
    record = pipes.pack(frames)
    for piece in (record[:5], record[5:11], record[11:5000]):
        assert outlet.write(piece) and inbox.take() is None and not inbox.pending()
    assert outlet.write(record[5000:]) and inbox.pending()
    assert inbox.take() == frames and inbox.take() is None
    outlet.close()
    inbox.close()


def test_only_the_announced_pipe_is_opened(tmp_path):
    """The pid may mean another process here, and the number another file."""
    inbox, other = pipes.Inbox(), pipes.Inbox()
    pid, fd, inode = inbox.address
    with open(tmp_path / "file", "wb") as file:
        wrong = ([pid, other.address[1], inode], [pid, file.fileno(), os.fstat(file.fileno()).st_ino])
        for address in (*wrong, [pid, 10**6, inode], [pid, fd], [pid, str(fd), inode], [10**30, fd, inode], []):
            with pytest.raises(OSError):
                pipes.Outlet(address)
    inbox.close()
    other.close()


@pytest.mark.parametrize("side", ["publisher", "consumer"])
def test_without_a_pipe_the_sockets_do_it(context, endpoints, monkeypatch, side):
    """A user has a limited number of pages in pipes, and one side may not see the other's."""
    publisher = publisher_on(context, endpoints, ["labeler:in"])

    def refuse(address):
        raise OSError("no such process")

    monkeypatch.setattr(f"evis.bus.{'consumers' if side == 'publisher' else 'subscriber'}.Outlet", refuse)
    subscriber = subscriber_on(context, endpoints)
    meet(publisher, subscriber)
    for i in range(20):
        deliver(publisher, subscriber, i)
    assert subscriber._piped is (side == "consumer")
    assert not publisher.finish(0)
    assert subscriber.receive(60_000) is END
    assert publisher.finish(60)
    subscriber.close()
    publisher.close()


def test_a_small_message_with_a_long_header_comes_over_the_socket(context, endpoints):
    publisher = publisher_on(context, endpoints, ["labeler:in"], WorldState)
    subscriber = subscriber_on(context, endpoints, kind=WorldState)
    meet(publisher, subscriber)
    names = [f"body {i} " + "x" * 50 for i in range(3000)]
    for bodies in (["a"], names, ["b"], names):
        pose, twist = np.zeros((1, 1, 0, 7)), np.zeros((1, 1, 0, 6))
        t, episodes = np.zeros(1, np.int64), np.zeros(1, np.int32)
        publisher.send(WorldState.dense(Header(0), t, pose, twist, episodes, names=bodies), timeout_s=60)
        assert zmq.select(subscriber.sockets(), [], [], 60)[0]
        message = subscriber.receive(60_000)
        assert message.names == bodies
        message.release()
    subscriber.close()
    publisher.close()
