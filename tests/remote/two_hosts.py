"""A graph whose messages a test sends itself, a server beside it, and a follower on another host; all in one thread."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zmq

from evis.bus import Publisher, Subscriber, endpoints_for
from evis.remote.follower import Follower
from evis.remote.keys import KeyPair
from evis.remote.server import Server
from evis.runtime.plan import NodePlan, Plan, TopicPlan
from evis.supervisor.run_directory import RunDirectory
from msgs.camera import CameraInfo, EventPacket
from msgs.header import Header
from msgs.topics import find_topic

EVENTS, INFO, IMAGE = "/cam0/events", "/cam0/info", "/cam0/image"
LIMIT_S = 30.0
"""For all that is waited for: far more than a loaded machine needs."""
HERE = "tcp://127.0.0.1:*"


def pair() -> KeyPair:
    return KeyPair(*zmq.curve_keypair())


def packet(k: int, events: int = 3) -> EventPacket:
    """Events that say which packet they are of."""
    t, xy = np.full(events, k, np.int64), np.full(events, k % 600, np.uint16)
    offsets, on = np.array([0, events]), np.ones(events, np.uint8)
    return EventPacket(Header(k), env_offsets=offsets, t=t, x=xy, y=xy, p=on, width=640, height=640)


def info() -> CameraInfo:
    return CameraInfo(Header(0), name="cam0", width=640, height=640, k=np.eye(3), distortion=np.zeros(0))


class Graph:
    """A run with one node that publishes events, images and, latched, what the camera is."""

    def __init__(self, run_id: str) -> None:
        self.context = zmq.Context()
        self.directory = RunDirectory()
        kinds = {name: find_topic(name).type.__name__ for name in (EVENTS, INFO, IMAGE)}
        topics = {name: TopicPlan(name, kind, "camera", name[6:]) for name, kind in kinds.items()}
        node = NodePlan("camera", "a:B", {}, "camera", outputs={topic.port: name for name, topic in topics.items()})
        self.plan = Plan("graph", run_id, str(self.directory.path), nodes={"camera": node}, topics=topics)
        self.publishers: dict[str, Publisher] = {}
        for name in topics:
            self.start_again(name)
        self.publishers[INFO].send(info())
        self.plan.save(self.directory.path / "plan.json")

    def start_again(self, name: str) -> None:
        """Puts a new publisher of a topic in the place of the one that is there."""
        if name in self.publishers:
            self.publishers[name].close()
        where, kind = endpoints_for(self.directory.path, name), find_topic(name).type
        self.publishers[name] = Publisher(
            self.context, name, "camera", where, [], message_type=kind, latched=name == INFO
        )
        self.publishers[name].start()

    def pump(self) -> None:
        for publisher in self.publishers.values():
            publisher.pump()

    def close(self) -> None:
        for publisher in self.publishers.values():
            publisher.close()
        self.context.destroy(linger=0)
        self.directory.close()


class Hosts:
    """Does a little on both hosts at each `turn`, in one thread."""

    def __init__(self, near: Path, far: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.near, self.far, self._monkeypatch = near, far, monkeypatch
        self.server_key, self.follower_key = pair(), pair()
        self.said: list[str] = []
        self.follower: Follower | None = None
        self._context = zmq.Context()
        self._readers: list[Subscriber] = []
        self.graph = self.start_graph("first")
        self.server = self.serve()

    def start_graph(self, run_id: str) -> Graph:
        self._monkeypatch.setenv("XDG_RUNTIME_DIR", str(self.near))
        self.graph = Graph(run_id)
        return self.graph

    def serve(self, address: str = HERE) -> Server:
        self.server = Server(self.graph.plan, address, self.server_key, {self.follower_key.public: "other"})
        return self.server

    def follow(self, **changed: Any) -> Follower:
        """Starts to follow, with other arguments than the right ones where they are given."""
        self._monkeypatch.setenv("XDG_RUNTIME_DIR", str(self.far))
        right = {"address": self.server.address, "key": self.follower_key, "server": self.server_key.public}
        self.follower = Follower(**{**right, **changed}, say=self.said.append)
        return self.follower

    def turn(self, *, graph: bool = True, server: bool = True, follower: bool = True) -> None:
        if graph:
            self.graph.pump()
        if server:
            self.server.serve(1)
        if follower and self.follower is not None:
            self.follower.follow()

    def until(self, condition: Callable[[], Any], **who: bool) -> Any:
        """Takes turns until something is true, and gives it."""
        end = time.monotonic() + LIMIT_S
        while not (value := condition()):
            assert time.monotonic() < end, f"it did not happen; {self.said}"
            self.turn(**who)
        return value

    def connected(self) -> Follower:
        follower = self.follow()
        self.until(lambda: follower.run)
        return follower

    def reader(self, topic: str, every: bool = True) -> Subscriber:
        """Reads a topic on the other host, as any tool does; what is sent from now on comes."""
        assert self.follower is not None and self.follower.run is not None
        where = endpoints_for(self.follower.run.plan.directory, topic)
        reader = Subscriber(
            self._context, topic, "tool", "tap", where, message_type=find_topic(topic).type, tap=True, every=every
        )
        reader.start()
        self._readers.append(reader)
        wanted = self.graph.publishers[topic].tapped_by_eager if every else self.graph.publishers[topic].tapped
        self.until(wanted)
        return reader

    def close(self) -> None:
        for reader in self._readers:
            reader.close()
        if self.follower is not None:
            self.follower.close()
        self.server.close()
        self.graph.close()
        self._context.destroy(linger=0)
