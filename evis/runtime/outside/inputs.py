"""Receives, by a socket of its own, the messages that outside programs send for the inputs of a node."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgpack

from evis.bus.endpoints import outside_socket
from evis.bus.links import Link, LinkLost, Listener
from evis.runtime.node import Node
from evis.runtime.outside.controlled_input import ControlledInput, Say, answer
from msgs.codec import decode
from msgs.header import Message
from msgs.topics import find_topic

GONE = "is gone without a word"
LONGEST_NAME = 200
LOOK_EVERY_S = 0.005
"""Interval at which it looks for newcomers while the graph is busy [s]: each look costs 10 us."""


class OutsideInputs:
    """Receives what outside programs give to the inputs of one node, each controlled by one program at a time.

    node: whose inputs they are. ports: the inputs that nobody in the graph gives, with their topics. directory: of the
    run. waits: whether steps may wait for a controller; a run that keeps to the wall clock cannot. now_ns: tells the
    stamp that the node published last [ns]. say: takes a level and a line for the user. on_control: called before a
    controller is let in. note: what a controller is told of in the log beside its name.
    """

    def __init__(
        self,
        node: Node,
        ports: Mapping[str, str],
        directory: str,
        *,
        waits: bool,
        now_ns: Callable[[], int],
        say: Say,
        on_control: Callable[[], None],
        note: str = "",
    ) -> None:
        self._node = node
        self._path = outside_socket(directory, node.name)
        self._ports = {topic: port for port, topic in ports.items()}
        self._waits = waits
        self._now_ns = now_ns
        self._say = say
        self._on_control = on_control
        self._listener: Listener | None = None
        self._links: list[Link] = []
        self._look_at = 0.0
        delayed = {port: topic for port, topic in ports.items() if node.INPUTS[port].delayed}
        self.controlled = {port: ControlledInput(topic, say, note) for port, topic in delayed.items()}
        """Who controls what, by port."""

    def open(self) -> None:
        """Binds the socket."""
        self._listener = Listener(self._path)

    def sockets(self) -> Sequence[int]:
        """Lists file descriptors for a poller: call `pump` when one is readable."""
        return [] if self._listener is None else [self._listener.fileno(), *(link.fileno() for link in self._links)]

    def pump(self) -> bool:
        """Handles connections and packets that have arrived, without waiting. True when there were any."""
        if self._listener is None:
            return False
        progress = False
        if (now := time.monotonic()) >= self._look_at:
            self._look_at = now + LOOK_EVERY_S
            while (link := self._listener.accept()) is not None:
                self._links.append(link)
        for link in list(self._links):
            try:
                if (packet := link.receive()) is not None:  # one at a time: who sends many holds nobody up
                    progress = True
                    self._answer(link, packet)
            except LinkLost:
                self._drop(link)
                progress = True
        return progress

    def close(self) -> None:
        """Ends all connections; a controller is told that the graph has ended."""
        for link in self._links:
            answer(link, op="lost", why="the graph has ended")
            link.close()
        self._links = []
        if self._listener is not None:
            self._listener.close()
            self._listener = None

    def _drop(self, link: Link) -> None:
        self._links.remove(link)
        link.close()
        for controlled in self.controlled.values():
            if controlled.controller is link:
                controlled.end_control(self._now_ns(), GONE, "warning")

    def _answer(self, link: Link, packet: list[bytes]) -> None:
        try:
            asked = msgpack.unpackb(packet[0])
            op, topic = asked["op"], asked.get("topic", "")
            if not isinstance(op, str) or not isinstance(topic, str):
                raise TypeError("op and topic are names")
        except Exception as error:  # msgpack raises several unrelated types on hostile input
            raise LinkLost(f"what came is no request: {error}") from None
        try:
            if op == "leave":
                self._leave(link)
            elif topic not in self._ports:
                raise ValueError(f"{self._node.name} takes no {topic!r:.80} from outside")
            elif op == "attach":
                self._attach(link, self._ports[topic], asked)
            elif op == "message":
                self._take(link, self._ports[topic], decode(packet[1:], find_topic(topic).type))
            else:
                raise ValueError(f"no request is called {op!r:.80}")
        except ValueError as error:  # MessageError is one
            answer(link, op="refused", why=str(error))

    def _attach(self, link: Link, port: str, asked: Mapping[str, Any]) -> None:
        controlled = self.controlled.get(port)
        if controlled is None:
            raise ValueError(f"{self._ports_of(port)} is nothing to control")
        if controlled.controller not in (None, link):
            raise ValueError(f"{controlled.controller_name} controls {controlled.topic} already; it must leave first")
        offer = dict(self._node.offer(port))
        lockstep = self._waits if asked.get("lockstep") is None else bool(asked["lockstep"])
        if lockstep and not self._waits:
            raise ValueError("this run keeps to the wall clock and waits for nobody; attach with lockstep=False")
        patience_s = math.inf if asked.get("patience_s") is None else asked["patience_s"]
        if not isinstance(patience_s, int | float) or not patience_s >= 0:  # which NaN is not either
            raise ValueError("patience_s must be a number of seconds, or be left out to wait without end")
        name = asked.get("who", "a program")
        if not isinstance(name, str):
            raise ValueError("who must be a text: the name that the log tells")
        name = " ".join(name.split())[:LONGEST_NAME]
        who = f"{name} (process {link.peer}, outside)"
        self._on_control()
        controlled.begin_control(link, who, self._now_ns(), lockstep, patience_s)
        answer(link, op="welcome", lockstep=lockstep, offer=offer, stamp_ns=self._now_ns())

    def _ports_of(self, port: str) -> str:
        return next(topic for topic, name in self._ports.items() if name == port)

    def _leave(self, link: Link) -> None:
        for controlled in self.controlled.values():
            if controlled.controller is link:
                controlled.end_control(self._now_ns(), f"has left {controlled.topic}")

    def _take(self, link: Link, port: str, message: Message) -> None:
        controlled = self.controlled.get(port)
        if controlled is not None and controlled.controller is not link:
            raise ValueError(f"{controlled.topic} is not this program's to give: it has to attach first")
        try:
            if controlled is not None and (late := controlled.mistimed(message.header.stamp_ns, self._now_ns())):
                raise ValueError(late)
            self._node.admit(port, message)
            if controlled is None:
                self._node.receive(port, message)
        except ValueError as error:
            self._refuse(port, controlled, str(error))
            raise
        if controlled is not None:
            self._node.count("outside_actions")
            controlled.put(message)
        answer(link, op="taken", stamp_ns=self._now_ns())

    def _refuse(self, port: str, controlled: ControlledInput | None, why: str) -> None:
        """Counts a refused message, and warns of the first of each controller, which may send a thousand in a
        second."""
        self._node.count(f"refused_{port}s")
        if controlled is None:
            self._say("warning", f"refused: {why}")
            return
        controlled.refused += 1
        if controlled.refused == 1:
            self._say("warning", f"refused from {controlled.controller_name}: {why}; the next ones are only counted")
