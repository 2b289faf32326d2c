"""A program outside takes control of a run that makes several keyframes at once: from then on one at a time."""

from __future__ import annotations

from typing import Any

import pytest
from composed_runs import published

from evis.runtime.executor import Executor


@pytest.mark.parametrize("given", [{}, {"time_tolerance": 0.0005, "preset": "davis346", "width": 48, "height": 36}])
def test_who_takes_control_in_a_batch_changes_no_message_before_an_action(given: dict[str, Any]) -> None:
    """And from then on the events of a state are there before the next one."""
    order: list[tuple[int, int]] = []

    def at_state(executor: Executor, k: int) -> None:
        if k == 5:
            executor._take_singly()
        order.append((k, executor.progress()["events"]))

    want = published("robot_arm", batch=1, **given)
    assert published("robot_arm", at_state, **given) == want
    seen = dict(order)
    assert seen[1] == seen[4] == 0, "nothing of a batch before it is there"
    assert seen[6] > 0 and len({seen[k] for k in range(5, 9)}) == 4
