"""A simulation in several threads: one after the other as in one, and two at once are refused."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

import evis
from evis.simulation.caller import CallerNode


def test_a_second_thread_is_refused_and_the_first_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    inside, go_on = threading.Event(), threading.Event()
    take = CallerNode.take

    def waits(self: Any) -> Any:
        inside.set()
        assert go_on.wait(60)
        return take(self)

    with evis.Simulation("falling_objects", width=32, height=24) as sim, ThreadPoolExecutor(1) as other:
        sim.reset(seed=3)
        expected = [sim.step().events.t.tobytes() for _ in range(3)]
        sim.reset(seed=3)
        monkeypatch.setattr(CallerNode, "take", waits)
        first = other.submit(sim.step)
        assert inside.wait(60)
        for call in (sim.step, sim.reset, sim.state, sim.finish, lambda: sim.reset(seed=5), lambda: sim.run(0.1)):
            with pytest.raises(evis.SimulationError, match="another thread is in a call of this simulation"):
                call()
        go_on.set()
        # The steps of three threads, one after the other.
        got = [first.result(), other.submit(sim.step).result(), sim.step()]
        assert [step.events.t.tobytes() for step in got] == expected


def test_closing_waits_for_a_step_of_another_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    inside, go_on = threading.Event(), threading.Event()
    take = CallerNode.take

    def waits(self: Any) -> Any:
        inside.set()
        assert go_on.wait(60)
        return take(self)

    sim = evis.Simulation("falling_objects", width=32, height=24)
    with ThreadPoolExecutor(2) as others:
        sim.reset(seed=3)
        monkeypatch.setattr(CallerNode, "take", waits)
        step = others.submit(sim.step)
        assert inside.wait(60)
        closed = others.submit(sim.close)
        go_on.set()
        assert step.result().stamp_ns > 0 and closed.result() is None
    with pytest.raises(evis.SimulationError, match="the simulation is closed"):
        sim.step()
