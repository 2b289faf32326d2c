"""Publishes /clock of a process's sources and /diagnostics of its nodes, both as taps."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import zmq

from evis.bus import LocalPublisher, Publisher, endpoints_for
from evis.config.secret import Redactor
from evis.console.printable import printable
from evis.runtime.hosting.host import AnyPublisher, Host
from evis.runtime.hosting.wiring import system_topic
from evis.runtime.plan import Plan
from evis.runtime.profile import Profile
from msgs.diagnostics import Diagnostics
from msgs.header import Header
from msgs.topics import SYSTEM_TOPICS, find_topic
from msgs.world import Clock

PERIOD_S = 1.0
"""Interval of /diagnostics [s]."""
TAP_HZ = {"/clock": 1000.0, "/diagnostics": 0.0}
"""Most messages a second that a tap gets. Of /diagnostics it gets all: nodes of one process tell theirs at once, and a
limit would hide the second of two warnings."""
Say = Callable[[str, str, str], None]
"""Takes a node's name, a level and a line."""


def say_in_log(name: str, level: str, text: str) -> None:
    """Writes a line to the process's log."""
    line = f"{name}: {text}" if level == "info" else f"{name}: {level}: {text}"
    print(printable(line), file=sys.stderr, flush=True)


class Telemetry:
    """Owns the publishers of the system topics of one process.

    plan, process: what is run, and the process's name. context: of ZeroMQ, the process's. profile: times and counts of
    its nodes, to be told. redactor: takes the secrets out of what is told. say: takes each line of a node.
    """

    def __init__(
        self,
        plan: Plan,
        process: str,
        context: zmq.Context,
        profile: Profile,
        redactor: Redactor,
        say: Say,
    ) -> None:
        self._say = say
        self._profile = profile
        self._redactor = redactor
        self._started = time.monotonic_ns()
        self._sent_at = time.monotonic()
        self.publishers: dict[str, AnyPublisher] = {}
        for topic in SYSTEM_TOPICS:
            kind = find_topic(topic).type
            if plan.closed:
                self.publishers[topic] = LocalPublisher(topic, process, kind)
                continue
            endpoints = endpoints_for(plan.directory, system_topic(topic, process))
            self.publishers[topic] = Publisher(
                context, topic, process, endpoints, [], message_type=kind, tap_hz=TAP_HZ[topic]
            )

    def start_clock(self) -> None:
        """Notes that the graph starts now, which is the origin of the real-time factor."""
        self._started = time.monotonic_ns()

    def tick(self, host: Host) -> None:
        """Publishes the time of a source's newest message."""
        if self.publishers["/clock"].wanted():
            profile = self._profile.node(host.name)
            since = profile.stamp_ns - (profile.first_stamp_ns or 0)
            wall = max(time.monotonic_ns() - self._started, 1)
            header = Header(profile.stamp_ns, clock=profile.clock, episode=profile.episode)
            self.publishers["/clock"].send(Clock(header, real_time_factor=since / wall))

    def say(self, host: Host | None, name: str, level: str, text: str) -> None:
        """Writes one line to the process's log and publishes it as a Diagnostics message, both without secrets."""
        text = printable(self._redactor.text(text))  # also for the topic, which takes no name that is not UTF-8
        self._say(name, level, text)
        self.publishers["/diagnostics"].send(self._diagnostics(host, name, level, text))

    def periodic(self, hosts: dict[str, Host], *, force: bool = False) -> None:
        """Sends the diagnostics of every node, once per PERIOD_S."""
        now = time.monotonic()
        if now - self._sent_at < PERIOD_S and not force:
            return
        self._sent_at = now
        publisher = self.publishers["/diagnostics"]
        publisher.pump()
        if publisher.wanted():
            for name, host in hosts.items():
                publisher.send(self._diagnostics(host, name))

    def _diagnostics(self, host: Host | None, name: str, level: str = "ok", text: str = "") -> Diagnostics:
        profile = self._profile.node(name)
        values = profile.summary()
        values["stamp_ns"] = profile.stamp_ns
        if host is not None:
            values["queue"] = sum(len(queue) for queue in host.join.queues.values())
            values["waits_s"] = round(sum(p.stats()["waits_s"] for p in host.publishers.values()), 6)
        return Diagnostics(Header(time.time_ns(), clock="wall"), node=name, level=level, text=text, values=values)
