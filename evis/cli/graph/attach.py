"""Looks at a running graph from outside: finds it, and reads its topics by taps."""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from evis.runtime.plan import Plan
from evis.supervisor.run_directory import is_live, live_runs

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
    runs = live_runs()
    if run_id:
        runs = [path for path in runs if path.name.startswith(run_id)]
        if not runs:
            known = ", ".join(path.name for path in live_runs()) or "none"
            raise ValueError(f"no running graph '{run_id}'; there are: {known}")
    plans = list(_loaded(runs))
    if not plans:
        raise ValueError("no graph is running; start one with `evis launch NAME`")
    if len(plans) > 1:
        this, *others = (f"{plan.run_id} ({plan.name})" for plan in plans)
        line = f"{len(plans)} running graphs{f' begin with {run_id}' if run_id else ''}; this is the newest, {this}"
        print(f"evis: {line}; --run ID takes another: {', '.join(others)}", file=sys.stderr)
    return plans[0]


def _loaded(runs: Iterable[Path]) -> Iterator[Plan]:
    """Their plans; a run that ends just now has none."""
    for path in runs:
        with contextlib.suppress(OSError, ValueError):
            yield Plan.load(path / "plan.json").redacted()


def check_topic(plan: Plan, topic: str) -> str:
    """Returns `topic` if the graph has it. Raises ValueError naming the nearest one."""
    from evis.config.suggestions import nearest
    from msgs.topics import SYSTEM_TOPICS

    known = [*plan.topics, *SYSTEM_TOPICS]
    if topic not in known:
        raise ValueError(f"the graph has no topic '{topic}'; {nearest(topic, known)}")
    return topic


def listen(plan: Plan, topic: str, timeout_s: float | None = None) -> Iterator[tuple[float, Message]]:
    """Yields (time.monotonic() of arrival, message) as they come, until the graph ends or after `timeout_s`.

    Arrays of a message are valid until the next one is asked for. A tap is rate-limited: count messages by header.seq.
    """
    import zmq

    from evis.bus import Subscriber, endpoints_for
    from evis.runtime.control import ask_for
    from evis.runtime.host import system_topic
    from msgs.header import Message
    from msgs.topics import SYSTEM_TOPICS, find_topic

    names = [topic]
    if topic in SYSTEM_TOPICS:
        names = [system_topic(topic, process) for process in sorted({n.process for n in plan.nodes.values()})]
    elif plan.nodes[plan.topics[topic].node].dormant:
        ask_for(plan.directory, topic)
    context, poller = zmq.Context(), zmq.Poller()
    subscribers = []
    deadline = None if timeout_s is None else time.monotonic() + timeout_s
    try:
        for name in names:
            where = endpoints_for(plan.directory, name)
            subscriber = Subscriber(context, topic, "cli", "tap", where, message_type=find_topic(topic).type, tap=True)
            subscriber.start()
            poller.register(subscriber.socket, zmq.POLLIN)
            subscribers.append(subscriber)
        while subscribers and (deadline is None or time.monotonic() < deadline):
            poller.poll(100)
            for subscriber in list(subscribers):
                while (message := subscriber.receive(0)) is not None:
                    if not isinstance(message, Message):
                        poller.unregister(subscriber.socket)
                        subscriber.close()
                        subscribers.remove(subscriber)
                        break
                    yield time.monotonic(), message
                    message.release()
                    if deadline is not None and time.monotonic() > deadline:
                        break
            if not is_live(Path(plan.directory)):
                return
    finally:
        for subscriber in subscribers:
            subscriber.close()
        context.destroy(linger=0)
