"""Measures where a process's time goes, node by node: own time without what it calls downstream, and counters."""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from evis.runtime.whereabouts import Whereabouts
from evis.runtime.workers import spent_by_workers
from msgs.camera import CameraInfo, EventPacket, Frames, Keyframe, Samples
from msgs.header import Message


@dataclass
class NodeProfile:
    """Counts the times [s], messages and events of one node."""

    updates: int = 0
    busy_s: float = 0.0
    cpu_s: float = 0.0
    published: Counter[str] = field(default_factory=Counter)
    events: int = 0
    keyframes: int = 0
    frames: int = 0
    counters: Counter[str] = field(default_factory=Counter)
    results: dict[str, Any] = field(default_factory=dict)
    """What the node found, for the run's summary."""
    stamp_ns: int = 0
    first_stamp_ns: int | None = None
    """So far back that `stamp_ns` minus it is all the time that was played."""
    episode: int = 0
    clock: str = "sim"
    """Domain of `stamp_ns`."""
    made_elsewhere: bool = False
    """Its messages carry events and images that other nodes have made and counted."""
    _framed: dict[str, int] = field(default_factory=dict)
    """Stamp of the last frames that were counted of each camera."""
    first_event_at: float = 0.0
    """time.monotonic() when the first packet with an event left; 0 = not yet."""
    number: int = 0
    """As of `Whereabouts`."""

    def saw(self, topic: str, message: Message) -> None:
        """Counts a published message."""
        self.published[topic] += 1
        self._advance_to(message)
        if self.made_elsewhere:
            return
        if isinstance(message, EventPacket):
            if message.t is not None:
                self.events += len(message.t)
                if self.events and not self.first_event_at:
                    self.first_event_at = time.monotonic()
            if message.lost:
                self.counters["lost"] += message.lost
        elif isinstance(message, Keyframe):
            self.keyframes += message.image.shape[0]
        elif isinstance(message, Frames | Samples):
            camera = topic.rpartition("/")[0]
            # Both may be there, which have the same frames.
            if self._framed.get(camera) != message.header.stamp_ns:
                self.frames += len(message.t) * len(message.episodes)
            self._framed[camera] = message.header.stamp_ns

    def _advance_to(self, message: Message) -> None:
        """Advances the node's time to a message; a description at the start of a recording is no part of what is
        played."""
        stamp, episode = message.header.stamp_ns, message.header.episode
        if isinstance(message, CameraInfo) and message.header.clock == "sim":
            return
        if self.first_stamp_ns is None:
            self.first_stamp_ns = stamp
        elif episode > self.episode and stamp < self.stamp_ns:
            # It plays again: what was played before stays counted.
            self.first_stamp_ns += stamp - self.stamp_ns
            self.stamp_ns = stamp
        self.clock = message.header.clock
        self.episode = max(self.episode, episode)
        self.stamp_ns = max(self.stamp_ns, stamp)

    def summary(self) -> dict[str, Any]:
        """Returns plain numbers for the run's summary and /diagnostics."""
        return {
            "updates": self.updates,
            "busy_s": round(self.busy_s, 6),
            "cpu_s": round(self.cpu_s, 6),
            "ms_per_update": round(1e3 * self.busy_s / self.updates, 4) if self.updates else 0.0,
            "events": self.events,
            "keyframes": self.keyframes,
            "frames": self.frames,
            "stamp_ns": self.stamp_ns,
            "first_stamp_ns": self.first_stamp_ns,
            "first_event_at": self.first_event_at,
            "published": dict(self.published),
            "counters": {k: _plain(v) for k, v in self.counters.items()},
            **({"results": self.results} if self.results else {}),
        }


def _plain(value: Any) -> float | int:
    return value.item() if isinstance(value, np.generic) else value


class Profile:
    """Measures exclusive time per owner on one thread, of CPU time with what `Workers` spend for it: entering an inner
    owner stops the clock of the outer one."""

    def __init__(self, where: Whereabouts | None = None) -> None:
        """Takes what notes the present owner; None = nobody is to know."""
        self._where = where or Whereabouts()
        self._note = self._where.note
        self.nodes: dict[str, NodeProfile] = {}
        self._stack: list[NodeProfile] = []
        self._since_wall = self._since_cpu = 0.0

    def node(self, name: str) -> NodeProfile:
        """Returns the profile of a node (or of `bus` and `idle`), made on first use."""
        found = self.nodes.get(name)
        if found is None:
            found = self.nodes[name] = NodeProfile(number=self._where.number(name))
        return found

    def charge(self) -> None:
        """Charges the time since the last call to the current owner."""
        wall, cpu = time.perf_counter(), time.thread_time() + spent_by_workers()
        if self._stack:
            owner = self._stack[-1]
            owner.busy_s += wall - self._since_wall
            owner.cpu_s += cpu - self._since_cpu
        self._since_wall, self._since_cpu = wall, cpu

    def inside(self, name: str) -> ChargedBlock:
        """Charges the time within the block to `name`."""
        return ChargedBlock(self, self.node(name))

    def enter(self, owner: NodeProfile) -> NodeProfile:
        """Charges time to this owner from now on, and returns its profile."""
        self.charge()
        self._stack.append(owner)
        self._note[0] = owner.number
        return owner

    def leave(self) -> None:
        """Ends the current owner's time, and charges the one before it again."""
        self.charge()
        self._stack.pop()
        self._note[0] = self._stack[-1].number if self._stack else 0


class ChargedBlock:
    """Charges the time within a block to one owner; a class, because it is entered a dozen times in a step."""

    __slots__ = ("_owner", "_profile")

    def __init__(self, profile: Profile, owner: NodeProfile) -> None:
        self._profile, self._owner = profile, owner

    def __enter__(self) -> NodeProfile:
        return self._profile.enter(self._owner)

    def __exit__(self, *_: object) -> None:
        self._profile.leave()
