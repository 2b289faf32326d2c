"""A Ctrl-C in the middle of something: the simulation says that it stands, and begins anew as if nothing had been."""

from __future__ import annotations

from typing import Any

import pytest

import evis
from evis.simulation.caller import CallerNode
from evis.simulation.errors import SimulationError
from msgs.header import Message


@pytest.fixture(scope="module")
def sim():
    with evis.Simulation("falling_objects", width=32, height=24, outputs=["events"]) as made:
        yield made


def interrupt(monkeypatch: pytest.MonkeyPatch, owner: type, method: str) -> None:
    """The next call of a method is made, and Ctrl-C comes before its caller has noted that."""
    original = getattr(owner, method)

    def interrupted(self: Any) -> None:
        monkeypatch.undo()
        original(self)
        raise KeyboardInterrupt

    monkeypatch.setattr(owner, method, interrupted)


def digest(sim: evis.Simulation) -> list[bytes]:
    sim.reset(seed=3)
    return [sim.step().events.t.tobytes() for _ in range(3)]


def test_a_reset_that_was_interrupted_can_be_made_again(sim, monkeypatch):
    expected = digest(sim)
    interrupt(monkeypatch, Message, "release")  # a node's own account of what it holds is wrong from here on
    with pytest.raises(KeyboardInterrupt):
        sim.reset(seed=4)
    assert digest(sim) == expected


def test_a_step_that_was_interrupted_does_not_go_on(sim, monkeypatch):
    expected = digest(sim)
    interrupt(monkeypatch, CallerNode, "take")
    with pytest.raises(KeyboardInterrupt):
        sim.step()
    with pytest.raises(SimulationError, match=r"has stopped .*; reset\(\) begins anew"):
        sim.step()
    assert digest(sim) == expected
