"""Looks at a running graph from outside: finds it, and reads its topics by taps."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING

from evis.client.running import choose, which_of_several
from evis.runtime.plan import Plan

if TYPE_CHECKING:
    from msgs.header import Message


def add_run_option(parser: argparse.ArgumentParser) -> None:
    """Adds --run, which every command has that looks at a running graph."""
    parser.add_argument(
        "--run", metavar="ID", help="which running graph, by the start of its id; the newest if not given"
    )


def find_run(run_id: str | None) -> Plan:
    """Returns the plan of a running graph, without its secrets; says on stderr which of several it is.

    Raises ValueError when there is none.
    """
    plan, others = choose(run_id)
    if line := which_of_several(run_id, plan, others, "--run ID takes another"):
        print(f"evis: {line}", file=sys.stderr)
    return plan


def listen(plan: Plan, topic: str, timeout_s: float | None = None) -> Iterator[tuple[float, Message, str]]:
    """Yields (time.monotonic() of arrival, message, who sent it) as they come, until the graph ends or after
    `timeout_s`.

    A tap of a tool is rate-limited: count messages by header.seq, of each sender by itself.
    """
    from evis.client.topics import TopicReader

    deadline = None if timeout_s is None else time.monotonic() + timeout_s
    with TopicReader(plan, topic, every=False) as reader:
        while True:
            left_s = None if deadline is None else deadline - time.monotonic()
            if left_s is not None and left_s <= 0:
                return
            if (message := reader.read(left_s)) is None:
                return
            yield reader.arrived_at, message, reader.sender
