"""Finds whether a graph plays a recording, and which part: the page says where it is instead of "live"."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

from evis.runtime.plan import NodePlan, Plan


def recording(plan: Plan) -> dict[str, Any] | None:
    """Describes the recording that the graph's source plays: {"node", "file", "again", "start", "end"}; None for
    none.

    start, end: in the recording's own time [s], None where only reading it to the end would tell. again: it is played
    over and over, so that its episodes are the rounds.
    """
    for node in plan.nodes.values():
        name = _file_of(node)
        if name:
            start, end = _limits(node)
            again = bool(node.params.get("again"))
            return {"node": node.name, "file": Path(name).name, "again": again, "start": start, "end": end}
    return None


def _file_of(node: NodePlan) -> str:
    """Returns the file that a node plays in a device's or a simulator's place; empty for none."""
    if node.target.endswith(":ReplayerNode"):
        return str(node.params.get("bag") or "")
    if node.target.endswith(":CameraNode") and not node.params.get("emulate"):
        return str(node.params.get("file") or "")
    return ""


def _limits(node: NodePlan) -> tuple[float | None, float | None]:
    if not node.target.endswith(":ReplayerNode"):
        return None, None
    start, end = _limits_of_bag(str(node.params["bag"]))
    if start is None or end is None:
        return None, None
    start += float(node.params.get("start") or 0)
    length = node.params.get("duration")
    return start, end if length is None else min(end, start + float(length))


@functools.lru_cache(maxsize=4)
def _limits_of_bag(path: str) -> tuple[float | None, float | None]:
    """Returns the first and last stamp of a bag [s], by its index; None for one that cannot be read."""
    from evis.bag import BagError
    from evis.bag.reader import BagReader

    try:
        with BagReader(path) as reader:
            return reader.start_ns / 1e9, reader.end_ns / 1e9
    except (OSError, BagError):
        return None, None
