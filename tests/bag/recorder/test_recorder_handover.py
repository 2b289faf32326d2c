"""Messages are recorded by a thread while the graph goes on: in order, kept meanwhile, as many as there is room for."""

import threading

import numpy as np
import pytest
from bag_messages import scene
from hand_driven_nodes import make_node

from evis.bag import BagError
from evis.bag.reader import BagReader
from msgs.camera import EventPacket
from msgs.header import Header
from nodes.recorder import handover
from nodes.recorder.handover import Handover
from nodes.recorder.node import RecorderNode


class Slot:
    """Counts who needs the arrays of one message."""

    def __init__(self):
        self.pins = 0

    def pin(self):
        self.pins += 1

    def unpin(self):
        self.pins -= 1
        assert self.pins >= 0


def message(k, count=10):
    t = np.full(count, k + 1, np.int64)
    x, p = np.zeros(count, np.uint16), np.zeros(count, np.uint8)
    packet = EventPacket(Header(k + 1, k), np.array([0, count], np.int64), t, x, x, p, width=9, height=9)
    packet._slot = Slot()
    return packet


class Taker:
    """Takes a message when it may."""

    def __init__(self):
        self.taken, self.may, self.fails = [], threading.Semaphore(0), None

    def __call__(self, topic, message):
        assert self.may.acquire(timeout=60)
        if message.header.seq == self.fails:
            raise BagError("the disk is full")
        self.taken.append((topic, message.header.seq, message.t.copy()))


def test_a_message_is_kept_until_it_was_taken():
    taker = Taker()
    hand = Handover(taker)
    sent = [message(k) for k in range(3)]
    for one in sent:
        hand.put("/cam0/events", one)
    assert [one._slot.pins for one in sent] == [1, 1, 1] and not taker.taken
    taker.may.release(3)
    hand.finish()
    assert [one._slot.pins for one in sent] == [0, 0, 0]
    assert [(topic, seq, t.tolist()) for topic, seq, t in taker.taken] == [
        ("/cam0/events", k, [k + 1] * 10) for k in range(3)
    ]
    hand.close()


def test_what_was_taken_is_released_where_nothing_more_comes():
    taker = Taker()
    hand = Handover(taker)
    sent = [message(k) for k in range(2)]
    for one in sent:
        hand.put("/cam0/events", one)
    taker.may.release(1)
    while not taker.taken or hand._worker.unfinished > 1:
        pass
    hand.release()
    assert [one._slot.pins for one in sent] == [0, 1]
    taker.may.release(1)
    hand.close()
    assert sent[1]._slot.pins == 0


@pytest.mark.parametrize("told", [True, False])
def test_a_failure_is_told_once_and_nothing_stays_kept(told):
    taker = Taker()
    taker.fails = 1
    hand = Handover(taker)
    sent = [message(k) for k in range(5)]
    for one in sent[:4]:
        hand.put("/cam0/events", one)
    taker.may.release(9)
    hand._worker.wait()
    with pytest.raises(BagError, match="the disk is full"):
        if told:
            hand.put("/cam0/events", sent[4])
        else:
            hand.finish()
    hand.release()
    hand.close()
    assert not any(one._slot.pins for one in sent) and [seq for _, seq, _ in taker.taken] == [0]


@pytest.mark.parametrize("count, most", [(1, handover.MAX_MESSAGES), (handover.MAX_BYTES // 53, 4)])
def test_no_more_waits_than_there_is_room_for(count, most):
    """Messages of 13 bytes an event: by their number where they are small, by their size where they are large."""
    taker = Taker()
    hand = Handover(taker)
    for k in range(most):
        hand.put("/cam0/events", message(k, count))
    late = threading.Thread(target=lambda: hand.put("/cam0/events", message(most, count)))
    late.start()
    late.join(0.3)
    assert late.is_alive() and not taker.taken
    taker.may.release(most + 1)
    late.join(60)
    hand.finish()
    assert [seq for _, seq, _ in taker.taken] == list(range(most + 1))
    hand.close()


def test_many_of_one_topic_keep_no_other_waiting():
    """As a GPU's keyframes come: sixteen states, then sixteen packets."""
    taker = Taker()
    hand = Handover(taker)
    for topic in ("/state", "/cam0/events"):
        for k in range(handover.MAX_MESSAGES):
            hand.put(topic, message(k, 1))
    assert not taker.taken
    taker.may.release(2 * handover.MAX_MESSAGES)
    hand.finish()
    assert len(taker.taken) == 2 * handover.MAX_MESSAGES
    hand.close()


def test_a_slow_recorder_writes_the_same_bag(tmp_path, monkeypatch):
    """Arrays are read after `receive` has returned."""
    for name, wait_s in (("a", 0.0), ("b", 0.01)):
        node = make_node(RecorderNode, path=str(tmp_path / name), topics=["*"])
        node.setup()
        write, pause = node.recorder.write, threading.Event()
        monkeypatch.setattr(node._handover, "_take", lambda *m, s=wait_s, r=write, p=pause: (p.wait(s), r(*m)))
        for k in range(6):
            for topic, one in scene(k).items():
                node.receive(topic, one)
        node.finish()
        node.close()
    read = []
    for name in "ab":
        with BagReader(tmp_path / name) as reader:
            found = [(topic, m.header, [a.tobytes() for a in m.arrays().values()]) for topic, m in reader.messages()]
            read.append(found)
            assert not reader.problem
    assert read[0] == read[1] and len(read[0]) > 30
