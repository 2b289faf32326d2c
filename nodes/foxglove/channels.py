"""Names the channels of each topic of a graph, as its bag names them, and encodes a message for those that are read."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from evis.bag.ros import images, mapping, schemas
from evis.bag.ros.events import decoded
from evis.bag.ros.mapping import META, ROS_TYPES
from evis.runtime.plan import Plan
from msgs.camera import EventPacket, Image
from msgs.fields import array_specs, environment_key
from msgs.header import Message
from msgs.topics import SYSTEM_TOPICS, find_topic

PICTURE = "/picture"
"""Suffix of the picture that is drawn of event packets."""
PREVIEW = "/preview"
"""Suffix of the keyframe's picture for people."""
LEFT_OUT = ("Samples",)
"""Messages between nodes alone, a gigabyte a second of them."""
MOST_ENVS = 16
"""Environments that get channels."""
_JSON_SCHEMA = '{"type": "object"}'


class Frame(NamedTuple):
    """Holds one message of a channel: its time [ns] and its bytes."""

    time_ns: int
    payload: bytes


@dataclass(frozen=True)
class Channel:
    """Describes a channel. topic: the graph's. env: the environment that it is of, None where it is not of a single
    one. ros_type: "" = JSON.
    """

    number: int
    topic: str
    env: int | None
    suffix: str
    kind: str
    ros_type: str

    @property
    def base(self) -> str:
        """Returns the name without the suffix."""
        return self.topic if self.env is None else f"/env{self.env}{self.topic}"

    def advertised(self) -> dict[str, Any]:
        """Returns the channel as a client is told of it."""
        cdr = bool(self.ros_type)
        return {
            "id": self.number,
            "topic": self.base + self.suffix,
            "encoding": "cdr" if cdr else "json",
            "schemaName": self.ros_type or f"evis/{self.kind}",
            "schema": schemas.DEFINITIONS[self.ros_type] if cdr else _JSON_SCHEMA,
            "schemaEncoding": "ros2msg" if cdr else "jsonschema",
        }


def suffixes(kind: str) -> dict[str, str]:
    """Returns what a message of a type becomes: suffix of the topic -> ROS type, "" = JSON."""
    ros_type = ROS_TYPES.get(kind, "")
    parts = dict.fromkeys(images.PARTS.get(kind, {}).values(), schemas.IMAGE)
    drawn = {"EventPacket": PICTURE, "Keyframe": PREVIEW}.get(kind)
    parts |= {drawn: schemas.IMAGE} if drawn else {}
    return parts | ({"": ros_type, META: ""} if ros_type else {"": ""})


class Channels:
    """Holds the channels that there are. A number is given once, to one name."""

    def __init__(self, plan: Plan) -> None:
        self.all: dict[int, Channel] = {}
        self._of: dict[tuple[str, int | None], dict[str, Channel]] = {}
        envs = plan.args.get("envs", 1)
        self.envs = envs if isinstance(envs, int) and envs > 0 else 1
        """Environments, as far as the plan or a message has told."""
        types = {name: plan.topics[name].type for name in plan.open_topics()}
        types |= {name: find_topic(name).type.__name__ for name in SYSTEM_TOPICS}
        for name, kind in types.items():
            if kind not in LEFT_OUT:
                self.add(name, kind, self.envs if _divided(kind) else 1)

    def add(self, topic: str, kind: str, envs: int) -> list[Channel]:
        """Adds the channels of a topic of `envs` environments, and returns those that are new."""
        new: list[Channel] = []
        for env in [None] if envs == 1 else range(min(envs, MOST_ENVS)):
            if (topic, env) in self._of:
                continue
            made = {
                suffix: Channel(len(self.all) + place, topic, env, suffix, kind, ros_type)
                for place, (suffix, ros_type) in enumerate(suffixes(kind).items(), start=1)
            }
            self._of[topic, env] = made
            self.all |= {channel.number: channel for channel in made.values()}
            new += made.values()
        return new

    def of(self, topic: str, env: int | None) -> dict[str, Channel]:
        """Returns suffix -> channel of a topic and environment; empty where it has none."""
        return self._of.get((topic, env), {})


def _divided(kind: str) -> bool:
    """Tells whether messages of a type surely have a part for each environment, where there are several."""
    found = Message.TYPES.get(kind)
    if found is None:
        return False
    if found in (EventPacket, Image):
        return True
    specs = array_specs(found)
    return any((spec.dims[0] == "E" and not spec.optional) or environment_key(n, found) for n, spec in specs.items())


def encode(
    message: Message, topic: str, wanted: Collection[str], time_ns: int | None
) -> Iterable[tuple[str, list[Frame]]]:
    """Encodes a message of one environment for the suffixes that are `wanted`, as a bag has it, to be sent together.

    A sensor's own bytes are left out where their events are there as arrays. time_ns: of all frames; None = their own.
    """
    kind = type(message).__name__
    if not any(suffix in wanted for suffix in suffixes(kind) if suffix not in (PICTURE, PREVIEW)):
        return []
    if isinstance(message, EventPacket) and decoded(message) and message.raw is not None:
        message = replace(message, raw=None, encoding="")
    parts, closing = mapping.encode(message, topic)
    frames: dict[str, list[Frame]] = {}
    for part in parts:
        if part.suffix in wanted:
            stamp = max(part.stamp_ns, 0) if time_ns is None else time_ns
            frames.setdefault(part.suffix, []).append(Frame(stamp, b"".join(part.buffers)))
    text = META if kind in ROS_TYPES else ""
    if text in wanted:
        frames[text] = [Frame(max(message.header.stamp_ns, 0) if time_ns is None else time_ns, closing)]
    return frames.items()
