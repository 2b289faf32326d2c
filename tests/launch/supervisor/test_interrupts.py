"""What asks a run to end is counted as a person means it."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from types import SimpleNamespace

import pytest

from evis.supervisor import interrupts as module
from evis.supervisor.interrupts import ONCE_S, Interrupts

Ask = Callable[[int, float], None]


@pytest.fixture
def ask(monkeypatch: pytest.MonkeyPatch) -> Ask:
    """`ask(number, after_s)`: a signal that comes so long after the one before."""
    clock = SimpleNamespace(now_s=1000.0)
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: clock.now_s))

    def send(number: int, after_s: float) -> None:
        clock.now_s += after_s
        os.kill(os.getpid(), number)
        time.sleep(1e-3)  # the handler has run

    return send


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_what_asks_twice_at_once_asks_once(number: signal.Signals, ask: Ask) -> None:
    """`timeout` sends SIGTERM to a program and its group, a terminal and who started a program both Ctrl-C: a run was
    ended by force."""
    interrupts = Interrupts()
    with interrupts.counted():
        ask(number, 0.0)
        ask(number, 0.9 * ONCE_S)
        assert interrupts.count == 1
        ask(number, 1.1 * ONCE_S)
        assert interrupts.count == 2


def test_who_may_hang_can_be_interrupted_after_all(ask: Ask) -> None:
    interrupts = Interrupts(most=1)
    with interrupts.counted():
        ask(signal.SIGTERM, 0.0)
        with pytest.raises(KeyboardInterrupt) as stop:
            ask(signal.SIGTERM, 2 * ONCE_S)
    assert stop.value.args == (signal.SIGTERM,)
