"""Small nodes that a launch file names by module: a ticking source, a relay, a collector, and ways to die."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from evis.config.params import Param
from evis.runtime.node import Input, Node, Output
from msgs.camera import Depth, EventPacket, Ids
from msgs.header import Header, Message

MS = 1_000_000


class Ticker(Node):
    """A source: one depth and one ids image per millisecond of its own time."""

    PARAMS = {
        "camera": Param(str, "cam0", "camera name"),
        "count": Param(int, 20, "messages, 0 = without end", minimum=0),
        "sleep": Param(float, 0.0, "per step", unit="s"),
        "setup_s": Param(float, 0.0, "slow start", unit="s"),
        "marker": Param(str, "", "file that says when it started to step"),
        "mark_at": Param(int, 0, "or when it came to this step"),
        "set_up": Param(str, "", "file that says when it was set up"),
    }
    OUTPUTS = {"depth": Output("/{camera}/depth"), "ids": Output("/{camera}/ids")}
    SOURCE = True

    def setup(self) -> None:
        time.sleep(self.params["setup_s"])
        self.k = 0
        if self.params["set_up"]:
            Path(self.params["set_up"]).write_text(str(time.monotonic()))

    def step(self, inputs: Mapping[str, Message]) -> bool:
        if self.k == self.params["mark_at"] and self.params["marker"]:
            Path(self.params["marker"]).write_text(str(time.monotonic()))
        time.sleep(self.params["sleep"])
        header = Header(self.k * MS)
        if self.wants("depth"):
            self.publish("depth", Depth(header, np.full((1, 4, 4), self.k, np.float32)))
        if self.wants("ids"):
            self.publish("ids", Ids(Header(self.k * MS), np.full((1, 4, 4), self.k, np.int32)))
        self.k += 1
        return not self.params["count"] or self.k < self.params["count"]


class Talkative(Ticker):
    """A source that has much to say at its end."""

    def close(self) -> None:
        print("\n".join(f"{self.name}: register {k} is not as it was before" for k in range(20_000)), flush=True)


class Late(Ticker):
    """A source that is set up a moment after it was told to end, before that is obeyed."""

    def setup(self) -> None:
        super().setup()
        while not signal.getitimer(signal.ITIMER_REAL)[0]:  # what a process does with SIGTERM
            time.sleep(0.01)


class Relay(Node):
    """Depth in, one event per message out."""

    PARAMS = {
        "camera": Param(str, "cam0", "camera name"),
        "gain": Param(float, 1.0, "a number with limits", unit="px", minimum=0.5, maximum=4),
        "colour": Param(str, "red", "a word of some", choices=("red", "green")),
        "fail_at": Param(int, -1, "raise at this message"),
        "die_at": Param(int, -1, "kill itself at this message"),
        "how": Param(int, int(signal.SIGKILL), "by this signal"),
        "once": Param(str, "", "only if this file is not there yet"),
    }
    INPUTS = {"depth": Input("/{camera}/depth")}
    OUTPUTS = {"events": Output("/{camera}/events"), "labels": Output("/{camera}/labels")}

    def setup(self) -> None:
        self.k = 0

    def update(self, inputs: Mapping[str, Message]) -> None:
        if self.k == self.params["fail_at"]:
            raise ValueError(f"told to fail at message {self.k}")
        if self.k == self.params["die_at"]:
            once = self.params["once"]
            if not once or not Path(once).exists():
                if once:
                    Path(once).write_text("x")
                print("my last words", flush=True)
                os.kill(os.getpid(), self.params["how"])
        stamp = inputs["depth"].header.stamp_ns
        packet = EventPacket(
            Header(stamp), np.array([0, 1]), np.array([stamp]), np.zeros(1, np.uint16), np.zeros(1, np.uint16),
            np.ones(1, np.uint8), width=4, height=4,
        )  # fmt: skip
        self.publish("events", packet)
        self.k += 1


class Collector(Node):
    """A sink: writes the stamps of what it got when it is closed, and `ended` when its inputs ended in order."""

    PARAMS = {"path": Param(str, "", "file"), "camera": Param(str, "cam0", "camera name")}
    INPUTS = {"events": Input("/{camera}/events", join=False)}

    def setup(self) -> None:
        self.lines: list[str] = []

    def receive(self, port: str, message: Message) -> None:
        self.lines.append(str(message.header.stamp_ns))

    def finish(self) -> None:
        self.lines.append("ended")

    def close(self) -> None:
        if self.params["path"]:
            Path(self.params["path"]).write_text("\n".join(self.lines))


class Recorder(Node):
    """A sink that takes what it is told."""

    PARAMS = {"topics": Param(list, [], "globs"), "path": Param(str, "", "file")}
    INPUTS = {"messages": Input("*", join=False)}

    def setup(self) -> None:
        self.seen: dict[str, int] = {}

    def receive(self, port: str, message: Message) -> None:
        self.seen[port] = self.seen.get(port, 0) + 1

    def close(self) -> None:
        if self.params["path"]:
            Path(self.params["path"]).write_text(repr(self.seen))


class Loop(Node):
    """Ids in, depth out: with a Ticker of the other kind it closes a circle."""

    PARAMS = {"camera": Param(str, "cam0", "camera name")}
    INPUTS = {"events": Input("/{camera}/events")}
    OUTPUTS = {"depth": Output("/{camera}/depth")}


class Labeler(Node):
    """Needs ids only for its labels."""

    PARAMS = {"camera": Param(str, "cam0", "camera name")}
    INPUTS = {"ids": Input("/{camera}/ids")}
    OUTPUTS = {"labels": Output("/{camera}/labels")}


class Viewer(Node):
    """Lives as long as the graph and reads nothing by itself."""

    def close(self) -> None:
        self.warn("the viewer closes")


class Picky(Node):
    """Needs depth for events and ids for labels; leaves a package out."""

    PARAMS = {"camera": Param(str, "cam0", "camera name"), "heavy": Param(bool, False, "imports something")}
    INPUTS = {
        "depth": Input("/{camera}/depth"),
        "ids": Input("/{camera}/ids"),
        "action": Input("/action", delayed=True),
    }
    OUTPUTS = {"events": Output("/{camera}/events"), "labels": Output("/{camera}/labels")}

    @classmethod
    def needs(cls, params: Mapping[str, Any], wanted: frozenset[str]) -> frozenset[str]:
        return frozenset({"events": "depth", "labels": "ids"}[port] for port in wanted)

    @classmethod
    def imports(cls, params: Mapping[str, Any]) -> Mapping[str, str]:
        return {} if params["heavy"] else {"mujoco": "nothing here moves by itself"}


class Sleeper(Node):
    """A source that hangs in its first step, deaf to everything but signals."""

    PARAMS = {"deaf": Param(bool, False, "to SIGTERM too"), "marker": Param(str, "", "file")}
    OUTPUTS = {"events": Output("/cam0/events")}
    SOURCE = True

    def step(self, inputs: Mapping[str, Message]) -> bool:
        if self.params["deaf"]:
            signal.signal(signal.SIGTERM, signal.SIG_IGN)
        Path(self.params["marker"]).write_text("x")
        while True:
            time.sleep(0.1)


class Torn(Ticker):
    """A source that is told to end in the middle of something, and fails by that."""

    def step(self, inputs: Mapping[str, Message]) -> bool:
        if self.k == 5:
            os.kill(os.getpid(), signal.SIGTERM)
            raise ValueError("a message was released more often than it was kept")
        return super().step(inputs)


class Echo(Node):
    """Depth in, a topic out that nobody else has."""

    INPUTS = {"depth": Input("/cam0/depth", join=False)}
    OUTPUTS = {"labels": Output("/cam7/labels")}

    def receive(self, port: str, message: Message) -> None:
        pass


class Gossip(Node):
    """Has a secret and tells it and its address wherever a node can."""

    PARAMS = {
        "password": Param(str, None, "a secret", optional=True, secret=True),
        "url": Param(str, "", "somewhere"),
        "fails": Param(bool, False, "to set itself up"),
    }

    def setup(self) -> None:
        self.at = 0.0
        print(f"{self.name}: I print {self.params['password']}", flush=True)
        if self.params["fails"]:
            os.write(2, f"{self.name}: I write {self.params['url']} past Python\n".encode())
            raise ValueError(f"I cannot call {self.params['url']} with {self.params['password']}")

    def idle(self) -> None:
        if time.monotonic() > self.at + 0.5:
            self.at = time.monotonic()
            self.warn(f"I call {self.params['url']} with {self.params['password']!r}")


class Threaded(Ticker):
    """A source with a thread of its own, which fails as soon as it steps."""

    def step(self, inputs: Mapping[str, Message]) -> bool:
        if self.k == 0:
            threading.Thread(target=self.work).start()
        return super().step(inputs)

    def work(self) -> None:
        raise ValueError("the serial port is gone")
