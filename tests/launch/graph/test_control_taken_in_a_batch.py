"""A program outside takes control of a run that makes several keyframes at once: from then on one at a time."""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import msgpack
import pytest
from composed_runs import published, run_of

from evis.bus.endpoints import outside_socket
from evis.bus.links import connect
from evis.runtime.executor import Executor
from evis.runtime.node import Node

STATES, BATCH = 25, 8
LENGTH_S, LONGER_S = (STATES - 1) / 30, 2.0


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"time_tolerance": 0.0005, "preset": "davis346", "width": 48, "height": 36},
        pytest.param({"device": "cuda"}, marks=pytest.mark.gpu),
    ],
)
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


@pytest.mark.gpu
def test_on_a_gpu_events_come_a_keyframe_late_until_somebody_takes_control() -> None:
    """Those of several environments too, which are no batch: from then on they are there before the next state."""

    def seen_where_control_is_taken_at(state: int) -> tuple[list[Any], dict[int, int]]:
        seen: dict[int, int] = {}

        def at_state(executor: Executor, k: int) -> None:
            if k == state:
                executor._take_singly()
            seen[k] = executor.progress()["events"]

        return published("robot_arm", at_state, device="cuda", envs=2, length_s=LENGTH_S), seen

    (messages, at_once), (same, late) = (seen_where_control_is_taken_at(state) for state in (0, 5))
    assert same == messages
    assert all(at_once[k] > at_once[k - 1] for k in range(1, STATES)), "every gap has events"
    assert [late[k] for k in range(1, 5)] == [at_once[k - 1] for k in range(1, 5)]
    assert [late[k] for k in range(5, STATES)] == [at_once[k] for k in range(5, STATES)]


class Rooms:
    """For how many keyframes there is room in the memory that nodes ask the executor for, one number per request."""

    def __init__(self) -> None:
        self.asked: defaultdict[str, list[int]] = defaultdict(list)

    def look_at(self, executor: Executor) -> None:
        """Listens from now on."""
        lend: Callable[..., Any] = executor.loan

        def loan(node: Node, port: str, arrays: Mapping[str, tuple[tuple[int, ...], Any]]) -> Any:
            self.asked[node.name] += {shape[0] for shape, _ in arrays.values()}
            return lend(node, port, arrays)

        executor.loan = loan  # type: ignore[method-assign]


@pytest.mark.parametrize(("tolerance", "gaps"), [(0, BATCH), (0.0005, 4)])
def test_from_then_on_a_gap_has_no_room_for_several(tolerance: float, gaps: int) -> None:
    """Which would be filled up with gaps of no length, and take twice the time of one."""
    rooms = Rooms()

    def at_state(executor: Executor, k: int) -> None:
        if k == 0:
            rooms.look_at(executor)
        elif k == BATCH + 1:
            executor._take_singly()

    run_of("robot_arm", at_state, length_s=LENGTH_S, time_tolerance=tolerance)
    singly = [1] * (STATES - BATCH)
    assert rooms.asked["renderer"] == [BATCH, *singly]
    # Of the first batch the first keyframe ends no gap: its frame is made by itself, and the gaps are one fewer.
    assert rooms.asked["interpolator"] == [1, *[gaps] * math.ceil((BATCH - 1) / gaps), *singly]


def test_it_stays_so_when_the_program_has_left(runtime: Path) -> None:
    """It may come again, and then finds the events of every keyframe there; what it was given none of is as ever."""
    rooms, said, program = Rooms(), [], []

    def at_state(executor: Executor, k: int) -> None:
        if k == 0:
            rooms.look_at(executor)
            executor.diagnose = lambda node, level, text: said.append(text)  # type: ignore[method-assign]
            program.append(connect(outside_socket(runtime, "physics")))
        elif k == BATCH + 1:
            for body in ({"op": "attach", "topic": "/action", "who": "it"}, {"op": "leave"}):
                program[0].send([msgpack.packb(body)])

    how: dict[str, Any] = {"length_s": LONGER_S, "time_tolerance": 0}
    assert published("robot_arm", at_state, directory=runtime, **how) == published("robot_arm", batch=1, **how)
    program[0].close()
    (left,) = [re.search(r"^it \(.*has left /action; from ([0-9.]+) s on", text) for text in said if "has left" in text]
    assert left is not None and any("controls /action from" in text for text in said)
    keyframes = round((LONGER_S - float(left[1])) * 30)
    assert keyframes > 2 * BATCH, "so that several could be made at once again"
    for node in ("renderer", "interpolator"):
        assert BATCH in rooms.asked[node] and rooms.asked[node][-keyframes:] == [1] * keyframes
