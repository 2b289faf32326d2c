"""A bag that is brought to the disk itself every second."""

import errno
import os
import threading
import time
from collections import defaultdict

import pytest
from bag_messages import scene
from hand_driven_nodes import make_node

from evis.bag import BagError
from evis.bag.mcap import sync
from evis.bag.reader import BagReader
from evis.bag.writer import BagWriter
from nodes.recorder.node import RecorderNode

WAIT_S = 60


class Disk:
    """Stands in for fdatasync: notes which file was synced, how much of it there was, and from which thread."""

    def __init__(self, monkeypatch, period_s=0.05):
        self.sizes = defaultdict(list)
        self.threads = set()
        self.error = None
        self.gate = threading.Event()
        self.gate.set()
        monkeypatch.setattr(os, "fdatasync", self._fdatasync)
        monkeypatch.setattr(sync, "SYNC_PERIOD_S", period_s)

    def _fdatasync(self, descriptor):
        size = os.fstat(descriptor).st_size
        self.threads.add(threading.current_thread().name)
        self.gate.wait(WAIT_S)
        if self.error:
            raise OSError(self.error, os.strerror(self.error))
        self.sizes[os.path.realpath(f"/proc/self/fd/{descriptor}")].append(size)


def until(condition):
    deadline = time.monotonic() + WAIT_S
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.005)
    return condition()


def write(writer, k=0):
    for topic, message in scene(k).items():
        writer.write(topic, message)


def test_once_in_every_period_that_wrote_something(tmp_path, monkeypatch):
    """Also what waited in an open chunk is in the file by then; a pause costs nothing; the end is on the disk."""
    disk = Disk(monkeypatch)
    path = tmp_path / "a.mcap"
    with BagWriter(path, chunk_period_s=1e6, sync=True) as writer:
        synced = disk.sizes[str(path)]
        assert len(synced) == 1  # so that a disk which takes no sync is known before anything is recorded
        for k in range(3):
            writer.write("/action", scene(k)["/action"])
            assert until(lambda expected=2 + k: len(synced) == expected)
            assert synced[-1] == path.stat().st_size and not writer.container._indexes
        time.sleep(3 * sync.SYNC_PERIOD_S)
        assert len(synced) == 4
        assert "bag-sync" in disk.threads
    assert synced[-1] == path.stat().st_size and len(synced) == 5


def test_the_period_is_a_second(tmp_path):
    """The one number of the promise, and the default that promises nothing."""
    assert sync.SYNC_PERIOD_S == 1.0
    with BagWriter(tmp_path / "a.mcap") as writer:
        assert writer.container.syncer is None
        assert all(t.name != "bag-sync" for t in threading.enumerate())


def test_a_slow_disk_holds_nobody_up(tmp_path, monkeypatch):
    """Messages are taken and come to the file while a sync does not return, and that it was late is counted."""
    disk = Disk(monkeypatch)
    node = make_node(RecorderNode, path=str(tmp_path / "a.mcap"), topics=["/*/keyframe"], sync=True)
    node.setup()
    disk.gate.clear()
    node.receive("/state", scene(0)["/state"])
    assert until(lambda: "bag-sync" in disk.threads)
    for k in range(1, 100):
        node.receive("/state", scene(k)["/state"])
    with BagReader(tmp_path / "a.mcap") as reader:
        assert "end" in reader.problem
    assert len(disk.sizes[str(tmp_path / "a.mcap")]) == 1
    time.sleep(2 * sync.SYNC_PERIOD_S)
    disk.gate.set()
    assert until(lambda: node.recorder.writer.container.syncer.late)
    node.receive("/state", scene(100)["/state"])
    node.finish()
    node.close()
    assert node.runtime.counters["late_syncs"] >= 1
    assert [level for level, text in node.runtime.said if "sync" in text] == ["warning"]
    with BagReader(tmp_path / "a.mcap") as reader:
        assert len(list(reader.messages(["/state"]))) == 101


def test_a_failed_sync_ends_the_recording_and_says_so(tmp_path, monkeypatch):
    """What was written until then can be read."""
    disk = Disk(monkeypatch)
    writer = BagWriter(tmp_path / "a.mcap", sync=True)
    disk.gate.clear()  # no sync returns before it fails
    write(writer)
    writer.flush()
    disk.error = errno.EIO
    disk.gate.set()
    assert until(lambda: writer.container.failure)
    with pytest.raises(BagError, match=r"a\.mcap: Input/output error while bringing it to the disk; .* on the disk"):
        write(writer, 1)
    writer.close()
    with BagReader(tmp_path / "a.mcap") as reader:
        assert not reader.problem and len(list(reader.messages())) >= len(scene(0)) - 1


@pytest.mark.parametrize("when", ["before", "at"])
def test_a_failure_that_no_message_met_is_told_at_the_end(tmp_path, monkeypatch, when):
    """The graph ended before another message came."""
    disk = Disk(monkeypatch, 0.05 if when == "before" else 1e6)
    writer = BagWriter(tmp_path / "a.mcap", sync=True)
    disk.gate.clear()  # no sync returns before it fails
    write(writer)
    disk.error = errno.ENOSPC
    disk.gate.set()
    assert when == "at" or until(lambda: writer.container.failure)
    with pytest.raises(BagError, match="No space left on device while bringing it to the disk"):
        writer.close()
    writer.close()


def test_a_full_disk_that_only_the_thread_met_is_told_at_the_end(tmp_path, monkeypatch):
    """Nothing was ever said of it: the flusher's failure waited for a message that did not come."""
    writer = BagWriter(tmp_path / "a.mcap", chunk_period_s=0.01)
    write(writer)
    writer.flush()

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(os, "writev", full)
        writer.write("/state", scene(1)["/state"])
        assert until(lambda: writer.container.failure)
    with pytest.raises(BagError, match="No space left on device after"):
        writer.close()


def test_what_cannot_be_synced_is_refused_before_it_starts(tmp_path):
    """A pipe has no disk behind it."""
    with pytest.raises(BagError, match=r"/dev/null cannot be synced .* without sync"):
        BagWriter("/dev/null", sync=True)
