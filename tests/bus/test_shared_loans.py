"""Messages that lie in one loan: it is free when the last of them is let go."""

import numpy as np
import pytest
import warp as wp

from evis.bus.local import LocalPublisher
from evis.bus.memory.device import DevicePool
from evis.runtime.delivery import Delivery
from msgs.camera import Depth
from msgs.header import Header


def test_messages_sent_together_share_a_loan():
    publisher = LocalPublisher("/cam0/depth", "painter", Depth)
    loan = publisher.loan(depth=((3, 4, 5), np.float32))["depth"]
    other = publisher.loan(depth=((1, 4, 5), np.float32))["depth"]
    sent = []
    with publisher.sharing_loans():
        for k in range(3):
            publisher.send(message := Depth(Header(k), loan[k : k + 1]))
            sent.append(message)
        publisher.send(alone := Depth(Header(3), other))
    assert [m.header.seq for m in sent] == [0, 1, 2]
    assert len({id(m._slot) for m in sent}) == 1 and alone._slot is not sent[0]._slot
    slot = sent[0]._slot
    for left, message in zip((2, 1, 0), sent):
        message.release()
        assert slot.pins == left
    # Nothing of it is given out again before that.
    assert publisher.loan(depth=((3, 4, 5), np.float32))["depth"].ctypes.data == loan.ctypes.data


def test_a_loan_that_no_message_lies_in_is_free_after_the_last():
    publisher = LocalPublisher("/cam0/depth", "painter", Depth)
    loan = publisher.loan(depth=((2, 4, 5), np.float32))["depth"]
    with publisher.sharing_loans():
        assert publisher.send(Depth(Header(0), np.zeros((1, 4, 5), np.float32))) is None
        assert publisher.send(Depth(Header(1), loan[:1])) is not None
    publisher.loan(depth=((2, 4, 5), np.float32))
    assert publisher.stats()["slots"] == 2  # the message has not let go of the first


def test_messages_on_a_device_share_a_loan_too():
    pool = DevicePool("/cam0/depth")
    device = wp.get_device("cpu")
    loan = pool.loan(device, {"depth": ((2, 4, 5), wp.float32)})["depth"]
    with pool.sharing_loans():
        slots = [pool.claim(Depth(Header(k), loan[k : k + 1])) for k in range(2)]
    assert slots[0] is slots[1] and slots[0].pins == 2
    for slot in slots:
        slot.unpin()
    assert pool.loan(device, {"depth": ((2, 4, 5), wp.float32)})["depth"].ptr == loan.ptr


class Consumer:
    """Stands for a node of this process that takes arrays where they are."""

    name = "reader"

    def __init__(self, device):
        self.device = device

    def takes(self, port, device):
        return self.device is not None


@pytest.mark.parametrize("device", [None, "cpu"])
def test_a_message_in_the_loan_of_another_topic_holds_it(device):
    """The two topics have one memory: it is given out again when both messages were let go."""
    lender, other = LocalPublisher("/cam0/depth", "painter", Depth), LocalPublisher("/cam0/far", "painter", Depth)
    ask = ((2, 4, 5), wp.float32 if device else np.float32)

    def loan():
        if device:
            return lender.loan_on(wp.get_device(device), {"depth": ask})["depth"]
        return lender.loan(depth=ask)["depth"]

    array, consumers = loan(), [(Consumer(device), "in")]
    messages = [Depth(Header(0), array), Depth(Header(0), array), Depth(Header(0), np.zeros((1, 4, 5), np.float32))]
    with lender.sharing_loans():
        Delivery.of(messages[0], lender, consumers).over()
        for message in messages[1:]:
            delivery = Delivery.of(message, other, consumers, (), lender)
            message.keep()
            delivery.over()
    assert messages[2]._slot is None  # it lies in no loan
    place = lambda array: array.ptr if device else array.ctypes.data
    taken = [loan() for _ in range(3)]
    assert place(array) not in [place(one) for one in taken]
    messages[1].release()
    assert place(loan()) == place(array)
    for publisher in (lender, other):
        publisher.close()


def test_blocks_of_shared_loans_are_nested():
    publisher = LocalPublisher("/cam0/depth", "painter", Depth)
    loan = publisher.loan(depth=((2, 4, 5), np.float32))["depth"]
    with publisher.sharing_loans():
        with publisher.sharing_loans():
            slot = publisher.send(Depth(Header(0), loan[:1]))
            slot.unpin()
        assert slot.pins == 1
        assert publisher.send(Depth(Header(1), loan[1:])) is slot
    assert slot.pins == 1
