"""Tells which views a topic offers, and describes the graph to the page."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from evis.runtime.plan import NodePlan, Plan
from msgs.topics import SYSTEM_TOPICS, UnknownTopic, find_topic
from nodes.visualizer.playback import recording
from nodes.visualizer.statistics import plain
from nodes.visualizer.views.events import EventView
from nodes.visualizer.views.images import ImageView
from nodes.visualizer.views.part import TopicView
from nodes.visualizer.views.tables import BoxView, MovingView, SeriesView, TableView, TriggerView

VIEWS: dict[str, dict[str, str]] = {
    "Keyframe": {"radiance": "image"},
    "Frames": {"luminance": "image"},
    "Samples": {"luminance": "image"},
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
    "WorldState": {"bodies": "table", "moving": "moving"},
    "Action": {"controls": "table"},
    "CameraInfo": {"camera": "table"},
    "Imu": {"samples": "series"},
    "Trigger": {"edges": "triggers"},
}
"""Message type -> its views, the first one the default -> kind of the view."""
MADE_OF = {"objects": {"boxes", "poses", "velocities", "contacts"}}
"""Views of labels that are made of others than the one of their own name."""
_OF_ONE = re.compile(r"/env(\d+)/(.+/.+)")
"""A topic that is of one environment of several, as the preview in a bag: its number, and what follows."""


def make_view(message_type: str, view: str, env: int, quality: int) -> TopicView:
    """Makes a view of a message type. Raises ValueError naming the views that there are."""
    kinds = VIEWS.get(message_type, {})
    if view not in kinds:
        raise ValueError(f"{message_type} has no view '{view}'; it has {', '.join(kinds) or 'none'}")
    if kinds[view] == "image":
        return ImageView(view, env, quality)
    others: dict[str, Callable[[str, int], TopicView]] = {
        "events": EventView, "boxes": BoxView, "moving": MovingView, "series": SeriesView, "triggers": TriggerView,
        "table": TableView,
    }  # fmt: skip
    return others[kinds[view]](view, env)


def camera_of(topic: str) -> str:
    """Returns the camera of a topic: `cam0` of `/cam0/events` and `/env0/cam0/image`; empty where it is of none."""
    of_one = _OF_ONE.fullmatch(topic)
    head, _, _ = (of_one[2] if of_one else topic).strip("/").rpartition("/")
    return head


def environment_of(topic: str) -> int | None:
    """Returns the environment that alone is on a topic: 0 of `/env0/cam0/image`; None for a topic of all of them."""
    of_one = _OF_ONE.fullmatch(topic)
    return int(of_one[1]) if of_one else None


def topics(plan: Plan) -> list[dict[str, Any]]:
    """Lists the topics that panels can show, grouped by camera, events and images first."""
    order = ["events", "image", "keyframe", "frames", "labels", "depth", "motion", "ids", "normal"]
    result = []
    for topic in map(plan.topics.__getitem__, plan.open_topics()):
        if topic.name in SYSTEM_TOPICS or topic.type not in VIEWS:
            continue
        tail = topic.name.rpartition("/")[2]
        publisher = plan.nodes.get(topic.node)
        result.append(
            {
                "name": topic.name,
                "type": topic.type,
                "camera": camera_of(topic.name),
                "env": environment_of(topic.name),
                "node": topic.node,
                "dormant": bool(publisher and publisher.dormant and not publisher.joins),
                "sure": not _may_be_missing(tail, publisher),
                "asked": _asked_labels(publisher) if topic.type == "Labels" else [],
                "views": _views(topic.type, publisher),
                "help": _help(topic.name),
                "rank": order.index(tail) if tail in order else len(order),
            }
        )
    return sorted(result, key=lambda t: (t["camera"] == "", t["camera"], t["rank"], t["name"]))


def _may_be_missing(tail: str, publisher: NodePlan | None) -> bool:
    """Tells whether a topic may stay empty: not every camera has frames, inertial samples and triggers."""
    return publisher is not None and publisher.target.endswith(":CameraNode") and tail not in ("events", "info")


def _asked_labels(publisher: NodePlan | None) -> list[str]:
    """Names what the labeler was told to make; nothing where it was not told, or where labels come out of a bag."""
    asked = (publisher.params.get("labels") if publisher else None) or []
    return [word.strip() for word in asked.split(",")] if isinstance(asked, str) else [str(word) for word in asked]


def _views(message_type: str, publisher: NodePlan | None) -> dict[str, str]:
    """Returns the views of a topic; of labels those that show what was asked for, where that is known."""
    views, asked = VIEWS[message_type], set(_asked_labels(publisher))
    if message_type != "Labels" or not asked:
        return views
    return {view: kind for view, kind in views.items() if MADE_OF.get(view, {view}) & asked}


def _help(name: str) -> str:
    try:
        return find_topic(name).help
    except UnknownTopic:
        return ""


def describe(plan: Plan, max_fps: float) -> dict[str, Any]:
    """Describes the graph as the page draws it: run, topics, nodes, edges, what was left out; no secret of the run."""
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
            "recording": recording(plan),
            "topics": topics(plan),
            "nodes": nodes,
            "edges": edges,
            "left_out": [{"what": item.what, "why": item.why} for item in plan.left_out],
        }
    )


def environments(plan: Plan) -> int:
    """Returns the number of parallel environments that the graph was started with."""
    value = plan.args.get("envs", 1)
    return value if isinstance(value, int) and value > 0 else 1
