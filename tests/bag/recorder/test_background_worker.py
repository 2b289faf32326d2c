"""Large chunks are written by a thread while others are compressed: the same bytes, and a full disk is told."""

import errno
import os
import threading
import time

import numpy as np
import pytest

from evis.bag import BagError
from evis.bag.mcap import container
from evis.bag.mcap.background_worker import BackgroundWorker
from evis.bag.reader import BagReader
from evis.bag.writer import BagWriter
from msgs.camera import EventPacket
from msgs.header import Header

COUNT, STEP_NS = 400_000, 33_000_000


def packet(k):
    """3.2 MB of events that do not compress."""
    rng = np.random.default_rng(k)
    t = np.sort(rng.integers(k * STEP_NS + 1, (k + 1) * STEP_NS, COUNT)).astype(np.int64)
    x, y, p = rng.integers(0, 640, COUNT), rng.integers(0, 480, COUNT), rng.integers(0, 2, COUNT)
    return EventPacket(
        Header((k + 1) * STEP_NS, k), np.array([0, COUNT], np.int64), width=640, height=480, t0_ns=k * STEP_NS,
        t=t, x=x.astype(np.uint16), y=y.astype(np.uint16), p=p.astype(np.uint8),
    )  # fmt: skip


def times(path):
    with BagReader(path) as reader:
        return [(m.header.seq, np.array(m.t)) for _, m in reader.messages()], reader.problem


class Disk:
    """Takes `room` bytes, each write after a pause."""

    def __init__(self, monkeypatch, pause=0.0, room=1 << 40):
        self._real, self.pause, self.room, self.moves = os.writev, pause, room, threading.Event()
        self.moves.set()
        monkeypatch.setattr(container.os, "writev", self)

    def __call__(self, descriptor, views):
        assert self.moves.wait(60)
        time.sleep(self.pause)
        if self.room < sum(map(len, views)):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        written = self._real(descriptor, views)
        self.room -= written
        return written


@pytest.mark.parametrize("threads", [2, 5])
def test_a_disk_that_stands_still_changes_no_byte_and_lets_the_next_chunks_be_compressed(
    tmp_path, monkeypatch, threads
):
    packets = [packet(k) for k in range(5)]
    for name in ("quick", "still"):
        with monkeypatch.context() as patch:
            disk = Disk(patch)
            writer = BagWriter(tmp_path / name, threads=threads)
            writer.write("/cam0/events", packets[0])
            if name == "still":
                disk.moves.clear()
            for one in packets[1:]:
                writer.write("/cam0/events", one)
            assert name == "quick" or len(writer.container._worker._waiting) >= 3
            disk.moves.set()
            writer.close()
    assert (tmp_path / "quick").read_bytes() == (tmp_path / "still").read_bytes()
    found, problem = times(tmp_path / "still")
    assert not problem and all(np.array_equal(t, packets[k].t) for k, t in found) and len(found) == 5


def test_a_message_that_waits_for_a_slow_disk_is_in_the_bag_after_a_flush(tmp_path, monkeypatch):
    Disk(monkeypatch, 0.1)
    writer = BagWriter(tmp_path / "a.mcap", threads=2)
    for k in range(3):
        writer.write("/cam0/events", packet(k))
    writer.flush()
    assert [k for k, _ in times(tmp_path / "a.mcap")[0]] == [0, 1, 2]
    writer.close()


@pytest.mark.parametrize("told", [True, False])
def test_a_disk_that_fills_behind_the_callers_back(tmp_path, monkeypatch, told):
    """The next message is refused, or `close` says so; what was whole in the file can be read with its index."""
    disk = Disk(monkeypatch, 0.02, room=9_000_000)
    writer = BagWriter(tmp_path / "a.mcap", threads=2)
    sent = 0
    expected = r"a\.mcap: No space left on device after .* MB; recording has stopped, the \d messages until then"
    if told:
        with pytest.raises(BagError, match=expected):
            for k in range(100):
                writer.write("/cam0/events", packet(k % 8))
                sent += 1
    else:
        for k in range(4):
            writer.write("/cam0/events", packet(k))
        writer.container._worker.wait()
    disk.room = 1 << 20  # what was cut off has given a little room back
    if told:
        writer.close()
    else:
        with pytest.raises(BagError, match=expected):
            writer.close()
    found, problem = times(tmp_path / "a.mcap")
    assert not problem and 1 < len(found) < 4 and all(np.array_equal(t, packet(k).t) for k, t in found)


def test_no_more_waits_than_there_is_room_for(tmp_path, monkeypatch):
    """Of a disk that stands still the sender hears by waiting, and memory does not fill."""
    monkeypatch.setattr("evis.bag.mcap.background_worker.MAX_BYTES", 8_000_000)
    disk = Disk(monkeypatch)
    writer, waiting = BagWriter(tmp_path / "a.mcap", threads=2), []
    writer.write("/cam0/events", packet(0))
    disk.moves.clear()

    def send():
        for k in range(1, 6):
            writer.write("/cam0/events", packet(k))
            waiting.append(writer.container._worker._bytes)

    sender = threading.Thread(target=send)
    sender.start()
    end = time.monotonic() + 60
    while max(waiting, default=0) < 2_000_000:
        assert time.monotonic() < end, "nothing waits"
        time.sleep(0.01)
    sender.join(1.0)
    assert sender.is_alive()
    disk.moves.set()
    sender.join(60)
    assert not sender.is_alive() and max(waiting) <= 8_000_000
    writer.close()
    assert len(times(tmp_path / "a.mcap")[0]) == 6


def test_what_waits_when_a_sync_fails_is_in_the_index(tmp_path, monkeypatch):
    """The bag is closed while a disk that stands still has not taken it yet."""
    disk = Disk(monkeypatch)
    writer = BagWriter(tmp_path / "a.mcap", threads=2)
    writer.write("/cam0/events", packet(0))
    disk.moves.clear()
    for k in range(1, 4):
        writer.write("/cam0/events", packet(k))
    writer.container._sync_failed(OSError(errno.EIO, os.strerror(errno.EIO)))
    threading.Timer(0.3, disk.moves.set).start()
    with pytest.raises(BagError, match="while bringing it to the disk"):
        writer.close()
    found, problem = times(tmp_path / "a.mcap")
    assert not problem and [k for k, _ in found] == [0, 1, 2, 3]


def test_a_thread_that_cannot_start_is_told_and_nobody_waits_for_it(monkeypatch):
    def refuse(thread):
        raise RuntimeError("can't start new thread")

    behind = BackgroundWorker("recorder")
    monkeypatch.setattr(threading.Thread, "start", refuse)
    with pytest.raises(OSError, match=r"the thread recorder cannot start .*ulimit -u"):
        behind.put(lambda: None, 8)
    assert behind.unfinished == 0
    behind.wait()
    behind.close()
