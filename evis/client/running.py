"""Finds the graphs that run on this machine."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path

from evis.runtime.plan import Plan
from evis.supervisor.run_directory import is_live, live_runs

_LOOK_S = 0.05


def running_graphs() -> list[Plan]:
    """Lists the plans of the running graphs, without their secrets, the newest first."""
    plans = []
    for path in live_runs():
        with contextlib.suppress(OSError, ValueError):  # a run that ends just now has none
            plans.append(Plan.load(path / "plan.json").redacted())
    return plans


def choose(run_id: str | None, wait_s: float = 0.0) -> tuple[Plan, list[Plan]]:
    """Chooses a running graph: the newest, or the newest whose id begins with `run_id`.

    Returns it, and the others that it might have been. wait_s: how long to wait for one [s]. Raises ValueError when
    there is none.
    """
    end = time.monotonic() + wait_s
    while True:
        plans = running_graphs()
        fitting = [plan for plan in plans if plan.run_id.startswith(run_id or "")]
        if fitting:
            return fitting[0], fitting[1:]
        if time.monotonic() >= end:
            break
        time.sleep(_LOOK_S)
    if run_id:
        known = ", ".join(map(named, plans)) or "none"
        raise ValueError(f"no running graph '{run_id}'; there are: {known}")
    raise ValueError("no graph is running; start one with `evis launch NAME`")


def named(plan: Plan) -> str:
    """Names a running graph for a person: its id and what was launched."""
    return f"{plan.run_id} ({plan.name})"


def which_of_several(run_id: str | None, plan: Plan, others: list[Plan], remedy: str) -> str:
    """Says which of several running graphs was taken, and by what `remedy` another is; "" where there was no choice."""
    if not others:
        return ""
    beginning = f" begin with {run_id}" if run_id else ""
    rest = ", ".join(map(named, others))
    return f"{len(others) + 1} running graphs{beginning}; this is the newest, {named(plan)}; {remedy}: {rest}"


def lives(plan: Plan) -> bool:
    """Says whether this graph still runs."""
    return is_live(Path(plan.directory))


def check_topic(plan: Plan, topic: str) -> str:
    """Returns `topic` if the graph has it. Raises ValueError naming the nearest one."""
    from evis.config.suggestions import nearest
    from msgs.topics import SYSTEM_TOPICS

    known = [*plan.topics, *SYSTEM_TOPICS]
    if topic not in known and any(topic in node.outside.values() for node in plan.nodes.values()):
        raise ValueError(f"{topic} is taken from outside the graph; no node of it publishes it, so nobody can read it")
    why = next((item.why for item in plan.left_out if item.what == topic), "")
    if topic not in known and why and plan.remote:
        raise ValueError(f"{topic} stays on its host: {why}")
    if topic not in known and why:
        raise ValueError(f"the graph does not make {topic}: {why}; a launch that records it makes it")
    if topic not in known:
        raise ValueError(f"the graph has no topic '{topic}'; {nearest(topic, known)}")
    return topic
