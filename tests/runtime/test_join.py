"""Joining by stamp: order kept, skipped stamps released and counted."""

from dataclasses import dataclass

import numpy as np

from evis.runtime.hosting.join import Join
from msgs.header import Header
from msgs.world import Action


@dataclass
class Slot:
    """Counts the pins that a message holds."""

    pins: int = 1

    def pin(self) -> None:
        self.pins += 1

    def unpin(self) -> None:
        self.pins -= 1


def message(stamp: int, episode: int = 0) -> tuple[Action, Slot]:
    m, slot = Action(Header(stamp, episode=episode), np.zeros((1, 1))), Slot()
    m._slot = slot  # type: ignore[misc]
    return m, slot


def test_waits_for_every_port() -> None:
    join = Join(["a", "b"])
    join.put("a", message(1)[0])
    assert not join.ready()
    join.put("b", message(1)[0])
    assert join.ready()
    assert {m.header.stamp_ns for m in join.take().values()} == {1}
    assert not join.ready()


def test_a_skipped_stamp_is_released_and_counted() -> None:
    join = Join(["a", "b"])
    lone, slot = message(1)
    join.put("a", lone)
    join.put("a", message(2)[0])
    join.put("b", message(2)[0])
    assert join.ready() and join.skipped == 1 and slot.pins == 0


def test_a_later_episode_is_newer_than_any_stamp() -> None:
    join = Join(["a", "b"])
    old, slot = message(10**9, episode=0)
    join.put("a", old)
    join.put("a", message(0, episode=1)[0])
    join.put("b", message(0, episode=1)[0])
    assert join.ready() and slot.pins == 0
    assert all(m.header.episode == 1 for m in join.take().values())


def test_over_only_when_nothing_more_can_be_joined() -> None:
    join = Join(["a", "b"])
    join.put("a", message(1)[0])
    join.end("a")
    assert not join.over()
    join.put("b", message(1)[0])
    join.take()
    assert join.over()


def test_the_rest_is_released() -> None:
    join = Join(["a", "b"])
    m, slot = message(1)
    join.put("a", m)
    assert join.drop_rest() == 1 and slot.pins == 0


def test_several_stamps_are_gathered_until_no_more_will_come():
    join, slots = Join(["a", "b"]), []
    for stamp in range(5):
        for port in ("a", "b") if stamp != 2 else ("a",):
            m, slot = message(stamp)
            join.put(port, m)
            slots.append(slot)
        if stamp == 1:
            assert join.gather(3) == []
    assert [found["b"].header.stamp_ns for found in join.gather(3)] == [0, 1, 3, 4]
    assert join.skipped == 1
    m, slot = message(5)
    join.put("a", m)
    join.put("b", message(5)[0])
    assert join.gather(2) == []
    join.end("a")
    assert [found["a"] for found in join.gather(2)] == [m]
    assert slot.pins == 1


def test_what_was_gathered_and_not_handed_out_is_released():
    join = Join(["a"])
    m, slot = message(0)
    join.put("a", m)
    assert join.gather(2) == []
    assert join.drop_rest() == 1
    assert slot.pins == 0
