"""What asks a run to end is counted as a person means it."""

from __future__ import annotations

import os
import signal
import time

import pytest

from evis.supervisor.interrupts import ONCE_S, Interrupts


def ask(number: int) -> None:
    os.kill(os.getpid(), number)
    time.sleep(1e-3)  # the handler has run


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_what_asks_twice_at_once_asks_once(number: signal.Signals) -> None:
    """`timeout` sends SIGTERM to a program and its group, a terminal and who started a program both Ctrl-C: a run was
    ended by force."""
    interrupts = Interrupts()
    with interrupts.counted():
        ask(number)
        ask(number)
        assert interrupts.count == 1
        time.sleep(2 * ONCE_S)
        ask(number)
        assert interrupts.count == 2


def test_who_may_hang_can_be_interrupted_after_all() -> None:
    interrupts = Interrupts(most=1)
    with interrupts.counted():
        ask(signal.SIGTERM)
        time.sleep(2 * ONCE_S)
        with pytest.raises(KeyboardInterrupt) as stop:
            ask(signal.SIGTERM)
    assert stop.value.args == (signal.SIGTERM,)
