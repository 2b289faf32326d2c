"""Sends messages from another program to the nodes of a running graph, and receives their answers."""

from __future__ import annotations

import math
import os
import sys
import time
from typing import Any

import msgpack
import numpy as np

from evis.bus.endpoints import outside_socket
from evis.bus.links import Link, LinkLost, connect
from evis.client.running import lives
from evis.runtime.plan import Plan
from msgs.codec import encode
from msgs.header import Message

ACTION, RESET, SETTINGS = "/action", "/reset", "/settings"
"""Topics that are taken from outside; of a camera's settings the last part."""
EVENTS = "/events"
_LOOK_S = 0.1
_KNOCK_S = 0.02
_SEND_S = 30.0
"""Longest time in which a node takes nothing from its socket [s]: a step may last."""


def taker(plan: Plan, topic: str) -> str:
    """Returns the node that takes a topic from outside the graph.

    Raises ConnectionRefusedError saying, in one line, why none does.
    """
    if plan.remote:
        raise ConnectionRefusedError(
            f"{plan.name} takes no {topic} from here: it runs on another host ({plan.remote}), and only programs there "
            "can act on it"
        )
    for node in plan.nodes.values():
        if topic in node.outside.values():
            return node.name
    at_once = max((int(node.params.get("batch") or 0) for node in plan.nodes.values()), default=0)
    offered = sorted({name for node in plan.nodes.values() for name in node.outside.values()})
    if topic in plan.topics:
        why = f"{plan.topics[topic].node}, which the launch file declares, publishes it"
    elif topic.endswith(SETTINGS) and (camera := topic.removesuffix(SETTINGS)) + EVENTS in plan.topics:
        made_by = plan.topics[camera + EVENTS].node
        why = (
            f"events of {camera[1:]} are simulated or replayed ({made_by}), and what they are made with is decided "
            "when the run starts, for the same seed to give the same bytes; start it again with other arguments"
        )
    elif any(node.target.endswith(":ReplayerNode") for node in plan.nodes.values()):
        why = "it replays a bag, in which everything has happened already"
    elif topic == ACTION and offered and at_once > 1:
        why = f"it makes {at_once} keyframes at once (batch), and nobody can act between them"
    elif offered:
        why = f"nobody in it reads that; it takes {' and '.join(offered)}"
    else:
        why = "nobody in it reads that, and it has no physics that could be controlled"
    raise ConnectionRefusedError(f"{plan.name} takes no {topic} from outside: {why}")


def program_name() -> str:
    """Names this program for the graph's log."""
    return os.path.basename(sys.argv[0] if sys.argv else "") or "a program"


def camera_settings(plan: Plan, camera: str | None) -> str:
    """Returns the topic on which a camera takes settings; None names the only one that does.

    Raises ValueError where several do, and ConnectionRefusedError where none does.
    """
    if camera is not None:
        return f"/{camera.strip('/')}{SETTINGS}"
    taken = sorted(t for node in plan.nodes.values() for t in node.outside.values() if t.endswith(SETTINGS))
    if len(taken) > 1:
        names = ", ".join(t.removesuffix(SETTINGS)[1:] for t in taken)
        raise ValueError(f"{plan.name} has several cameras that take settings: name one of {names}")
    if taken:
        return taken[0]
    seen = sorted(t for t in plan.topics if t.endswith(EVENTS))
    return seen[0].removesuffix(EVENTS) + SETTINGS if seen else SETTINGS


class Requests:
    """Speaks to one node of a running graph: asks for control of an input, gives messages.

    due_ns: stamp of the step that waits for an action, as far as it was told; None = none does.
    """

    def __init__(self, plan: Plan, node: str) -> None:
        """Connects, as soon as the node is there. Raises ConnectionError when the graph ends before that."""
        self.due_ns: int | None = None
        self.lost = ""
        """Why control was lost, until it is asked."""
        self._plan = plan
        self._link = self._connected(node)

    def _connected(self, node: str) -> Link:
        while True:
            try:
                return connect(outside_socket(self._plan.directory, node))
            except OSError:
                if not lives(self._plan):
                    raise ConnectionError(f"{self._plan.name} has ended") from None
                time.sleep(_KNOCK_S)

    def attach(self, topic: str, lockstep: bool | None, patience_s: float) -> dict[str, Any]:
        """Asks for control of a topic, and returns the welcome. Raises ConnectionRefusedError with the reason."""
        patience = None if math.isinf(patience_s) else patience_s
        body = {"op": "attach", "topic": topic, "who": program_name(), "lockstep": lockstep, "patience_s": patience}
        answer = self._ask([msgpack.packb(body)])
        if answer["op"] == "refused":
            raise ConnectionRefusedError(f"{self._plan.name} takes no {topic} from outside: {answer['why']}")
        self.due_ns, self.lost = None, ""  # what came before the welcome is of an earlier time in control
        return answer

    def send(self, topic: str, message: Message) -> int:
        """Gives a message; returns the stamp [ns] of the state that the node published last.

        Raises ValueError for one that the node refuses, with its reason.
        """
        answer = self._ask([msgpack.packb({"op": "message", "topic": topic}), *encode(message)])
        if answer["op"] == "refused":
            raise ConnectionError(f"{self._plan.name}: {self.lost}") if self.lost else ValueError(answer["why"])
        if topic == ACTION:
            self.due_ns = None
        return int(answer["stamp_ns"])

    def leave(self) -> None:
        """Hands back what it controls."""
        self._send([msgpack.packb({"op": "leave"})])

    def catch_up(self, timeout_s: float = 0.0) -> None:
        """Takes in what has come, and waits for something if nothing has. Raises ConnectionError as the graph ends."""
        while (packet := self._receive(timeout_s)) is not None:
            self._note(packet)
            timeout_s = 0.0

    def _receive(self, timeout_s: float) -> dict[str, Any] | None:
        try:
            packet = self._link.receive(timeout_s)
        except LinkLost:
            raise ConnectionError(f"{self._plan.name} has ended") from None
        return None if packet is None else msgpack.unpackb(packet[0])

    def _note(self, packet: dict[str, Any]) -> bool:
        """Remember what the node tells; False for what is an answer."""
        if packet["op"] == "due":
            self.due_ns = int(packet["stamp_ns"])
        elif packet["op"] == "lost":
            self.lost, self.due_ns = str(packet["why"]), None
        else:
            return False
        return True

    def _send(self, frames: list[Any]) -> None:
        try:
            self._link.send(frames, _SEND_S)
        except LinkLost as error:
            raise ConnectionError(f"{self._plan.name}: {error}") from None

    def _ask(self, frames: list[Any]) -> dict[str, Any]:
        self._send(frames)
        while (packet := self._receive(_LOOK_S)) is None or self._note(packet):
            pass
        return packet

    def close(self) -> None:
        """Ends the connection."""
        self._link.close()


def controls_of(values: Any, envs: int, count: int) -> np.ndarray:
    """Returns controls float64 [E, nu] of one value per actuator, the same for all environments, or of [E, nu].

    Raises ValueError for what are no numbers; their shape is for the node to judge.
    """
    try:
        if np.iscomplexobj(values):
            raise TypeError
        controls = np.asarray(values, np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"an action is {count} number(s), one per actuator, and not {values!r:.80}") from None
    if controls.ndim > 2:
        raise ValueError(f"an action has shape {list(controls.shape)}, it must be [{count}] or [{envs}, {count}]")
    if controls.ndim < 2:
        controls = controls.reshape(1, -1)
        if controls.shape[1] == count:
            controls = np.repeat(controls, envs, axis=0)
    return np.ascontiguousarray(controls)
