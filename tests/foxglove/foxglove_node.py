"""A node for Foxglove on a made-up graph, the part of the executor that it uses, and a client of another library."""

from __future__ import annotations

import json
import struct
import time
from collections import Counter, defaultdict, deque
from collections.abc import Callable
from typing import Any

from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from websockets.sync.client import connect

from evis.runtime.plan import NodePlan, Plan, TopicPlan
from msgs.header import Message
from nodes.foxglove.node import FoxgloveNode

LIMIT_S = 60.0
"""For all that is waited for: only what hangs takes it."""
ENDED = "no more comes: the run has ended, or what serves it to Foxglove was stopped"
"""What clients are told at the end."""
TOPICS = {
    "/state": "WorldState", "/cam0/info": "CameraInfo", "/cam0/keyframe": "Keyframe", "/cam0/depth": "Depth",
    "/cam0/events": "EventPacket", "/cam0/samples": "Samples", "/cam0/labels": "Labels", "/cam0/imu": "Imu",
    "/cam0/image": "Image",
}  # fmt: skip


def make_plan(**args: Any) -> Plan:
    """A graph with one topic of each kind; the labeler sleeps until somebody asks for its labels."""
    plan = Plan("disk", "run-1", "", seed=7, args=args)
    for name, kind in TOPICS.items():
        node = "labeler" if kind == "Labels" else "simulator"
        plan.nodes[node] = NodePlan(node, "", {}, node, dormant=node == "labeler")
        plan.topics[name] = TopicPlan(name, kind, node, name.rpartition("/")[2], latched=kind == "CameraInfo")
    return plan


class FakeTap:
    """What `open_tap` gives."""

    def __init__(self, runtime: FakeRuntime, topic: str, callback: Callable[[Message], None]) -> None:
        self.runtime, self.topic, self.callback, self.lost = runtime, topic, callback, 0

    def close(self) -> None:
        del self.runtime.taps[self.topic]


class FakeRuntime:
    """Taps, requests and diagnostics of the executor, kept to be looked at."""

    def __init__(self, plan: Plan) -> None:
        self.plan, self.failure, self.refuse = plan, "", ""
        self.taps: dict[str, FakeTap] = {}
        self.requested: list[str] = []
        self.said: list[str] = []
        self.told: list[str] = []
        self.hidden: list[str] = []
        self.counted: Counter[str] = Counter()

    def open_tap(self, node: Any, topic: str, callback: Callable[[Message], None]) -> FakeTap:
        if topic == self.refuse:
            raise ValueError(f"nobody publishes {topic}")
        assert topic not in self.taps
        self.taps[topic] = FakeTap(self, topic, callback)
        return self.taps[topic]

    def request(self, topic: str) -> None:
        self.requested.append(topic)

    def diagnose(self, node: Any, level: str, text: str) -> None:
        self.said.append(text)

    def tell(self, node: Any, text: str) -> None:
        self.told.append(text)

    def hide(self, secret: str) -> None:
        self.hidden.append(secret)

    def count(self, node: Any, name: str, amount: float) -> None:
        self.counted[name] += int(amount)


class Served:
    """A node that serves a made-up graph."""

    def __init__(self, plan: Plan, **params: Any) -> None:
        self.runtime = FakeRuntime(plan)
        self.node = FoxgloveNode("foxglove", {"port": 0, **params})
        self.node.runtime = self.runtime  # type: ignore[assignment]
        self.node.setup()
        self.address = self.runtime.told[0].split()[1].replace("...", str(params.get("token")))

    def send(self, topic: str, message: Message) -> None:
        """Publishes a message."""
        message.check()
        self.node.idle()
        if topic in self.runtime.taps:
            self.runtime.taps[topic].callback(message)

    def until(self, condition: Callable[[], Any], step: Callable[[], None] = lambda: None) -> Any:
        """Runs the node until something holds, and gives it."""
        end = time.monotonic() + LIMIT_S
        while not (value := condition()):
            assert time.monotonic() < end, "it did not happen"
            step()
            self.node.idle()
            time.sleep(0.002)
        return value

    def until_tapped(self, *topics: str) -> None:
        """Runs the node until these topics are tapped, and no others."""
        self.until(lambda: self.runtime.taps.keys() == set(topics))


class Foxglove:
    """A client, of a library that is not the server's, that decodes by the schemas that it is told."""

    def __init__(self, address: str, **options: Any) -> None:
        options = {"subprotocols": ["foxglove.websocket.v1"], "max_size": None, "proxy": None, **options}
        self._connection = connect(address, **options)
        self.channels: dict[str, dict[str, Any]] = {}
        self.statuses: list[dict[str, Any]] = []
        self.times: list[int] = []
        self.received: dict[str, deque[tuple[int, bytes]]] = defaultdict(deque)
        self._names: dict[int, str] = {}
        self._next = 0

    def __enter__(self) -> Foxglove:
        self.ws = self._connection.__enter__()
        self.info = json.loads(self.ws.recv(LIMIT_S))
        while not self.channels:
            self.hear(LIMIT_S)
        return self

    def __exit__(self, *error: Any) -> None:
        self._connection.__exit__(*error)

    def say(self, op: str, **content: Any) -> None:
        self.ws.send(json.dumps({"op": op, **content}))

    def subscribe(self, *names: str) -> list[int]:
        """Subscribes to channels by name, and gives the ids of the subscriptions."""
        ids = list(range(self._next, self._next + len(names)))
        self._next += len(names)
        self._names |= dict(zip(ids, names))
        entries = [{"id": i, "channelId": self.channels[name]["id"]} for i, name in zip(ids, names)]
        self.say("subscribe", subscriptions=entries)
        return ids

    def hear(self, timeout: float) -> bool:
        """Takes in one message; False where none came in time."""
        try:
            message = self.ws.recv(timeout)
        except TimeoutError:
            return False
        if isinstance(message, str):
            body = json.loads(message)
            if body["op"] == "advertise":
                self.channels |= {channel["topic"]: channel for channel in body["channels"]}
            else:
                assert body["op"] == "status", body
                self.statuses.append(body)
        elif message[0] == 1:
            subscription, time_ns = struct.unpack_from("<IQ", message, 1)
            self.received[self._names[subscription]].append((time_ns, message[13:]))
        else:
            assert message[0] == 2 and len(message) == 9
            self.times.append(struct.unpack("<Q", message[1:])[0])
        return True

    def next(self, name: str, pump: Callable[[], None] = lambda: None) -> tuple[int, bytes]:
        """The next message of a channel; `pump` makes the graph go on."""
        end = time.monotonic() + LIMIT_S
        while not self.received[name]:
            assert time.monotonic() < end, f"nothing came on {name}"
            pump()
            self.hear(0.02)
        return self.received[name].popleft()

    def status(self, pump: Callable[[], None] = lambda: None) -> dict[str, Any]:
        """The next status."""
        end = time.monotonic() + LIMIT_S
        while not self.statuses:
            assert time.monotonic() < end, "no status came"
            pump()
            self.hear(0.02)
        return self.statuses.pop(0)

    def decode(self, name: str, payload: bytes) -> Any:
        """A message as mcap-ros2-support reads it by the advertised schema, or the JSON that it is."""
        channel = self.channels[name]
        if channel["encoding"] == "json":
            return json.loads(payload)
        schema = Schema(1, channel["schema"].encode(), channel["schemaEncoding"], channel["schemaName"])
        decoder = DecoderFactory().decoder_for(channel["encoding"], schema)
        assert decoder is not None
        return decoder(payload)

    def read(self, name: str, pump: Callable[[], None] = lambda: None) -> Any:
        """The next message of a channel, decoded."""
        return self.decode(name, self.next(name, pump)[1])
