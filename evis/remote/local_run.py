"""Offers the topics of a graph that runs on another host as those of a run on this one."""

from __future__ import annotations

import dataclasses
import os
import time
from collections import Counter

import zmq

from evis.bus import Publisher, endpoints_for, wire
from evis.bus.endpoints import check_bind
from evis.bus.publisher import LATCHED_QUEUE
from evis.bus.tap import TapSender, queue_length
from evis.remote.protocol import taps_of
from evis.runtime.hosting.wiring import system_topic, tap_hz
from evis.runtime.plan import NodePlan, Plan
from evis.runtime.process.control import ControlServer, control_address
from evis.runtime.telemetry import PERIOD_S
from evis.runtime.telemetry import TAP_HZ as SYSTEM_TAP_HZ
from evis.supervisor.run_directory import RunDirectory
from msgs.codec import Buffer
from msgs.diagnostics import Diagnostics
from msgs.header import Header, Message, missed_between
from msgs.topics import SYSTEM_TOPICS, find_topic

_LINGER_MS = 1000


class LocalTap:
    """Sends the messages of one topic, which come from another host, to readers here; and counts what is missing.

    topic: its name, which a system topic has of each process.
    """

    def __init__(self, context: zmq.Context, directory: str, name: str, topic: str) -> None:
        row = find_topic(topic)
        self.topic, self.type, self.latched = topic, row.type, row.latched
        hz = 0.0 if row.latched else SYSTEM_TAP_HZ[topic] if topic in SYSTEM_TOPICS else tap_hz(topic)
        self.sender = TapSender(topic, hz)
        self.lost = 0
        self._last: tuple[int, int, bool] | None = None
        where = endpoints_for(directory, name)
        check_bind(where.tap)
        self.socket = wire.open_socket(context, zmq.XPUB, LATCHED_QUEUE if row.latched else queue_length(topic))
        self.socket.setsockopt(zmq.MAXMSGSIZE, wire.MAX_TALK)
        self.sender.open(self.socket, where.tap)

    def wanted(self) -> tuple[bool, bool]:
        """Tells whether somebody reads it here, and whether somebody wants every message."""
        while wire.readable(self.socket):
            self.sender.handle_xpub(self.socket.recv_multipart())
        listened = self.sender.listeners > 0
        return listened, listened and self.sender.eager > 0

    def count(self, number: int, seq: int, every: bool) -> None:
        """Counts what is missing before a message: of a server that reads every one, by the topic's own numbers."""
        if self._last is not None:
            number_before, seq_before, all_before = self._last
            by_seq = every and all_before
            self.lost += missed_between(seq_before, seq) if by_seq else max(0, number - number_before - 1)
        self._last = number, seq, every

    def rest(self) -> None:
        """Forgets the last message, for nobody wants what follows it."""
        self._last = None
        self.sender.latched = None

    def renumbered(self) -> None:
        """Takes note that a server counts anew: until it has sent two, only the topic's own numbers tell of a loss."""
        if self._last is not None:
            self._last = (1 << 63, self._last[1], self._last[2])

    def send(self, message: Message, frames: list[Buffer]) -> None:
        """Hands a message on, frame by frame as it came, to who reads it here, as often as they want."""
        if self.latched:
            self.sender.latched = frames
        if self.sender.due(*message.environment):
            self.sender.send(frames)


class LocalRun:
    """Holds a private directory with the plan of a graph on another host and a tap of each of its topics.

    plan: the graph's, with the topics that are offered. remote: its address. Raises BusError and OSError.
    """

    def __init__(self, context: zmq.Context, plan: Plan, remote: str) -> None:
        self._directory = RunDirectory()
        self.node = f"remote.{os.getpid()}"
        own = NodePlan(self.node, "evis.remote.follower:Follower", {}, self.node)
        nodes = {**plan.nodes, self.node: own}
        self.plan = dataclasses.replace(plan, directory=str(self._directory.path), nodes=nodes, remote=remote)
        self.taps: dict[str, LocalTap] = {}
        self._publishers: list[Publisher] = []
        self._told_at = time.monotonic()
        try:
            directory = self.plan.directory
            for name, topic in taps_of(plan).items():
                self.taps[name] = LocalTap(context, directory, name, topic)
            for topic in SYSTEM_TOPICS:
                where = endpoints_for(directory, system_topic(topic, self.node))
                kind = find_topic(topic).type
                publisher = Publisher(context, topic, self.node, where, [], message_type=kind, tap_hz=0.0)
                publisher.start()
                self._publishers.append(publisher)
            self._control = ControlServer(control_address(directory))
            self.plan.save(self._directory.path / "plan.json")  # last, for who finds it looks for the rest
        except BaseException:
            self._directory.close()
            raise

    def sockets(self) -> list[zmq.Socket]:
        """Lists the sockets on which readers come and go, for a poller."""
        return [tap.socket for tap in self.taps.values()]

    def tell(self, values: Counter[str], level: str = "ok", text: str = "") -> None:
        """Publishes the state of the connection on /diagnostics, once a second, and at once what has a text."""
        # Who asks for a topic that is made on demand reads it as well, which is what reaches the other host.
        self._control.poll(0.0)
        for publisher in self._publishers:
            publisher.pump()
        if not text and time.monotonic() - self._told_at < PERIOD_S:
            return
        self._told_at = time.monotonic()
        header = Header(time.time_ns(), clock="wall")
        for publisher in self._publishers:
            if publisher.message_type is Diagnostics:
                publisher.send(Diagnostics(header, self.node, level, text, dict(values)))

    def close(self) -> None:
        """Tells all readers that the graph has ended, and removes the directory."""
        for tap in self.taps.values():
            tap.wanted()
            tap.sender.end([wire.END_HEADER])
            tap.socket.close(linger=_LINGER_MS)
        for publisher in self._publishers:
            publisher.finish(0.0)
            publisher.close()
        self._control.close()
        self._directory.close()
