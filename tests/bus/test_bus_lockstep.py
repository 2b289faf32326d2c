"""Declared consumers get every message, unchanged, whatever carries it and whoever else listens."""

from __future__ import annotations

import itertools
import time
from types import SimpleNamespace

import numpy as np
import pytest
from bus_workers import TOPIC, digest, image, publish, publisher_on, send_stream, truth, wait_for

from evis.bus import END, SlotPool, Subscriber, tap
from msgs.camera import Depth
from msgs.header import Header

COUNT = 400


def test_composed_gives_the_truth():
    """One process, no sockets: loans, pins and hand-over by reference."""
    pool = SlotPool(TOPIC, 3)

    def received():
        for i in range(COUNT):
            array = pool.loan({"depth": (image(i).shape, np.float32)})["depth"]
            array[...] = image(i)
            slot = pool.claim({"depth": array})
            yield i, array
            slot.unpin()

    assert digest(received()) == truth(COUNT)
    assert pool.live <= 3 and pool.spares == 0


@pytest.mark.parametrize("window", [1, 2, 4])
def test_two_processes_every_window(context, endpoints, reader, window):
    child = reader(endpoints, "labeler", window=window)
    publisher = publisher_on(context, endpoints, ["labeler:in"], window=window)
    wait_for(lambda: not publisher.missing())
    send_stream(publisher, COUNT)
    assert publisher.finish(60)
    report = child.hear()
    assert report["hash"] == truth(COUNT) and report["lost"] == report["rejected"] == 0
    assert report["shared"] == 3 * COUNT // 5  # three of the five sizes are above the inline limit
    stats = publisher.stats()
    assert stats["slots"] <= window + 1 and stats["spare_slots"] == 0
    publisher.close()


def test_array_in_the_loan_is_not_copied(context, endpoints, reader):
    child = reader(endpoints, "labeler")
    publisher = publisher_on(context, endpoints, ["labeler:in"])
    wait_for(lambda: not publisher.missing())
    for _ in range(5):
        out = publisher.loan(depth=((1, 100, 100), "float32"))["depth"]
        assert out.ctypes.data % 64 == 0
        out[...] = 1
        publisher.send(Depth(Header(0), depth=out)).unpin()
    assert publisher.stats()["copies"] == 0
    publisher.send(Depth(Header(0), depth=np.ones((1, 100, 100), np.float32))).unpin()
    assert publisher.stats()["copies"] == 1
    publisher.finish(60)
    assert child.hear()["count"] == 6
    publisher.close()


def test_unreachable_memory_falls_back_to_inline(context, endpoints, reader):
    publisher = publisher_on(context, endpoints, ["labeler:in", "recorder:in"])
    children = [reader(endpoints, "labeler", inline=True), reader(endpoints, "recorder")]
    wait_for(lambda: not publisher.missing())
    send_stream(publisher, COUNT)
    assert publisher.finish(60)
    publisher.close()
    for child in children:
        report = child.hear()
        assert report["hash"] == truth(COUNT) and report["lost"] == 0 and report["shared"] == 0


def test_three_consumers_one_of_them_slow(context, endpoints, reader):
    names = ["labeler", "recorder", "interpolator"]
    children = [reader(endpoints, n, sleep_s=0.002 if n == "recorder" else 0) for n in names]
    publisher = publisher_on(context, endpoints, [f"{n}:in" for n in names])
    wait_for(lambda: not publisher.missing())
    send_stream(publisher, COUNT)
    assert publisher.finish(60)
    assert [c.hear()["hash"] for c in children] == [truth(COUNT)] * 3
    publisher.close()


@pytest.mark.parametrize("sleep_s", [0.0, 0.2])
def test_a_viewer_changes_nothing(context, endpoints, reader, sleep_s, monkeypatch):
    """A tap, quick or slow, loses messages and knows how many; the declared consumer gets the same bytes.

    The publisher's rate limit runs on a clock that goes on by 1 ms per message, and the viewer has all the time for the
    end.
    """
    ticks = (0.001 * k for k in itertools.count())
    monkeypatch.setattr(tap, "time", SimpleNamespace(monotonic=lambda: next(ticks), sleep=time.sleep))
    monkeypatch.setattr(tap, "END_WAIT_S", 1e9)
    child = reader(endpoints, "labeler")
    publisher = publisher_on(context, endpoints, ["labeler:in"], tap_hz=200.0)
    viewer = reader(endpoints, "viewer", tap=True, sleep_s=sleep_s)
    wait_for(lambda: not publisher.missing() and publisher._tap.listeners)
    send_stream(publisher, COUNT)
    assert publisher.finish(60)
    assert child.hear()["hash"] == truth(COUNT)
    stats = publisher.stats()
    sent = COUNT // 5 + 1  # one more at the start
    assert (stats["tap_sent"], stats["tap_skipped"]) == (sent, COUNT - sent)
    publisher.close()
    if not sleep_s:
        seen = viewer.hear()
        assert 0 < seen["count"] < COUNT and seen["rejected"] == 0
        assert seen["count"] + seen["lost"] == COUNT  # the first message opened the rate limit, so none is before it


def test_many_small_messages_under_random_stalls(context, endpoints, reader):
    """libzmq looks at its reader only now and then; with a queue limit it would drop against that stale count."""
    count = 100_000
    child = reader(endpoints, "labeler", stall=7, window=16)
    publisher = publisher_on(context, endpoints, ["labeler:in"], window=16)
    wait_for(lambda: not publisher.missing())
    depth = np.zeros((1, 1, 1), np.float32)
    for i in range(count):
        depth[0, 0, 0] = i % 1000
        publisher.send(Depth(Header(i), depth=depth))
    assert publisher.finish(60)
    report = child.hear()
    assert (report["count"], report["lost"]) == (count, 0)
    expected = digest((i, np.full((1, 1, 1), i % 1000, np.float32)) for i in range(count))
    assert report["hash"] == expected
    publisher.close()


@pytest.mark.parametrize("count", [1, 60])
def test_last_message_arrives_when_the_publisher_exits(context, endpoints, child, count):
    """ipc drops what a sender wrote last when it closes (libzmq#4660), unless the credits are awaited."""
    subscriber = Subscriber(context, TOPIC, "labeler", "in", endpoints, message_type=Depth)
    subscriber.start()
    sender = child(publish, endpoints, ["labeler:in"], {"count": count})
    received = []
    while (message := subscriber.receive(60_000)) is not END:
        assert message is not None
        received.append((message.header.stamp_ns, message.depth.copy()))
        if len(received) == 1:
            sender.process.join(0.2)  # a stalled reader
        message.release()
    assert digest(iter(received)) == truth(count)
    sender.process.join(60)
    assert sender.process.exitcode == 0
    subscriber.close()


def test_kept_arrays_do_not_change(context, endpoints, reader):
    """A consumer that keeps messages while later ones flow: spare slots, counted, and nothing overwritten."""
    child = reader(endpoints, "interpolator", keep=4)
    publisher = publisher_on(context, endpoints, ["interpolator:in"])
    wait_for(lambda: not publisher.missing())
    send_stream(publisher, COUNT)
    assert publisher.finish(60)
    report = child.hear()
    assert report["hash"] == truth(COUNT) and report["changed"] == 0
    assert publisher.stats()["spare_slots"] > 0
    publisher.close()


def test_local_consumers_share_the_slots_of_the_loan(context, endpoints):
    """Composed nodes: by reference, without a copy, and the producer gets other memory while one of them keeps it."""
    publisher = publisher_on(context, endpoints, [])
    kept = []
    for i in range(20):
        out = publisher.loan(depth=((1, 100, 100), "float32"))["depth"]
        out[...] = i
        message = Depth(Header(i), depth=out)
        slot = publisher.send(message)
        assert slot is not None and message.depth is out
        message.keep()
        kept.append((i, message))
        slot.unpin()
        if len(kept) > 5:
            stamp, old = kept.pop(0)
            assert (old.depth == stamp).all()
            old.release()
    assert publisher.stats()["copies"] == 0 and publisher.stats()["slots"] <= 7
    publisher.close()


def test_a_loan_that_is_not_sent_goes_back():
    pool = SlotPool(TOPIC, 2)
    for _ in range(100):
        pool.loan({"depth": ((1, 9, 9), np.float32)})
        assert pool.claim({"depth": np.zeros((1, 9, 9), np.float32)}) is None
    assert pool.live == 1


def test_window_one_and_a_kept_message_do_not_stop_the_stream(context, endpoints, reader):
    child = reader(endpoints, "interpolator", keep=1, window=1)
    publisher = publisher_on(context, endpoints, ["interpolator:in"], window=1)
    wait_for(lambda: not publisher.missing())
    send_stream(publisher, 50)
    assert publisher.finish(60)
    assert child.hear()["hash"] == truth(50)
    publisher.close()


def test_a_tap_that_wants_every_message_is_not_held_to_the_rate(context, endpoints):
    """Only while it listens: then a viewer's rate holds again."""
    publisher = publisher_on(context, endpoints, [], tap_hz=1e-3)
    program = Subscriber(context, TOPIC, "program", "tap", endpoints, message_type=Depth, tap=True, every=True)
    viewer = Subscriber(context, TOPIC, "viewer", "tap", endpoints, message_type=Depth, tap=True)
    for tapping in (viewer, program):
        tapping.start()
    wait_for(lambda: publisher.missing() == [] and publisher._tap.listeners == 2 and publisher._tap.eager == 1)
    for k in range(5):
        publisher.send(Depth(Header(k), depth=image(k)))
        assert program.receive(60_000).header.seq == k
    program.close()
    wait_for(lambda: publisher.missing() == [] and publisher._tap.eager == 0)
    publisher.send(Depth(Header(5), depth=image(5)))
    stats = publisher.stats()
    assert (stats["tap_sent"], stats["tap_skipped"]) == (5, 1)
    viewer.close()
    publisher.close()
