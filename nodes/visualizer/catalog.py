"""Which views a topic offers, and the description of the graph that the page gets first."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from evis.plan import Plan
from msgs.topics import UnknownTopic, find_topic
from nodes.visualizer.statistics import plain
from nodes.visualizer.views.events import EventView
from nodes.visualizer.views.images import ImageView
from nodes.visualizer.views.part import View
from nodes.visualizer.views.tables import BoxView, SeriesView, TableView, TriggerView

SYSTEM = ("/clock", "/diagnostics")
"""Topics behind the status line and the Rates panel; not offered as panels."""

VIEWS: dict[str, dict[str, str]] = {
    "Keyframe": {"radiance": "image"},
    "Frames": {"luminance": "image"},
    "Image": {"image": "image"},
    "Depth": {"depth": "image"},
    "Motion": {"motion": "image"},
    "Ids": {"ids": "image"},
    "Normal": {"normal": "image"},
    "EventPacket": {"events": "events"},
    "Labels": {
        "segmentation": "image",
        "semantic": "image",
        "flow": "image",
        "depth": "image",
        "objects": "table",
        "boxes": "boxes",
    },
    "WorldState": {"bodies": "table"},
    "Action": {"controls": "table"},
    "CameraInfo": {"camera": "table"},
    "Imu": {"samples": "series"},
    "Trigger": {"edges": "triggers"},
}
"""Message type -> its views, the first one the default -> kind of the view."""


def make_view(message_type: str, view: str, env: int, quality: int) -> View:
    """A view of a message type. Raises ValueError naming the views that there are."""
    kinds = VIEWS.get(message_type, {})
    if view not in kinds:
        raise ValueError(f"{message_type} has no view '{view}'; it has {', '.join(kinds) or 'none'}")
    if kinds[view] == "image":
        return ImageView(view, env, quality)
    others: dict[str, Callable[[str, int], View]] = {
        "events": EventView, "boxes": BoxView, "series": SeriesView, "triggers": TriggerView, "table": TableView,
    }  # fmt: skip
    return others[kinds[view]](view, env)


def camera_of(topic: str) -> str:
    """`cam0` of `/cam0/events`; empty for a topic of no camera."""
    head, _, _ = topic.strip("/").rpartition("/")
    return head


def topics(plan: Plan) -> list[dict[str, Any]]:
    """The topics that panels can show, grouped by camera, events and images first."""
    order = ["events", "image", "keyframe", "frames", "labels", "depth", "motion", "ids", "normal"]
    result = []
    for topic in plan.topics.values():
        if topic.name in SYSTEM or topic.type not in VIEWS:
            continue
        tail = topic.name.rpartition("/")[2]
        publisher = plan.nodes.get(topic.node)
        result.append(
            {
                "name": topic.name,
                "type": topic.type,
                "camera": camera_of(topic.name),
                "node": topic.node,
                "dormant": bool(publisher and publisher.dormant),
                "views": VIEWS[topic.type],
                "help": _help(topic.name),
                "rank": order.index(tail) if tail in order else len(order),
            }
        )
    return sorted(result, key=lambda t: (t["camera"] == "", t["camera"], t["rank"], t["name"]))


def _help(name: str) -> str:
    try:
        return find_topic(name).help
    except UnknownTopic:
        return ""


def describe(plan: Plan, max_fps: float) -> dict[str, Any]:
    """The graph as the page draws it: run, topics, nodes and edges, what was left out; no secret of the run."""
    plan = plan.redacted()
    nodes = [
        {
            "name": n.name,
            "type": n.target.rpartition(":")[2].removesuffix("Node") or n.name,
            "process": n.process,
            "dormant": n.dormant,
            "params": n.params,
        }
        for n in plan.nodes.values()
    ]
    edges = [
        {"from": t.node, "to": e.node, "topic": t.name, "kind": e.kind} for t in plan.topics.values() for e in t.edges
    ]
    return plain(
        {
            "op": "hello",
            "name": plan.name,
            "run_id": plan.run_id,
            "mode": plan.mode,
            "seed": plan.seed,
            "duration_s": plan.duration_s,
            "args": plan.args,
            "envs": environments(plan),
            "max_fps": max_fps,
            "topics": topics(plan),
            "nodes": nodes,
            "edges": edges,
            "left_out": [{"what": item.what, "why": item.why} for item in plan.left_out],
        }
    )


def environments(plan: Plan) -> int:
    """Number of parallel environments that the graph was started with."""
    value = plan.args.get("envs", 1)
    return value if isinstance(value, int) and value > 0 else 1
