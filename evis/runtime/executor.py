"""Runs the nodes of one process: joins their inputs, calls them, and delivers what they publish.

Nodes of one process call each other directly (scheduler.py); everything else goes over the bus. A message is taken from
the bus only where its node can take it: so nothing is lost, and memory is bounded.
"""

from __future__ import annotations

import copy
import math
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import zmq

from evis.bus import END
from evis.config.secret import Redactor
from evis.gpu.early_context import begin_contexts
from evis.runtime.hosting.host import AnyPublisher, Host, Subscription
from evis.runtime.hosting.node_call import NodeCall, NodeFailed
from evis.runtime.hosting.taps import Taps
from evis.runtime.hosting.wiring import Wiring, load_class
from evis.runtime.node import Node
from evis.runtime.outputs import Outputs
from evis.runtime.outside.inputs import OutsideInputs
from evis.runtime.plan import Plan
from evis.runtime.profile import Profile
from evis.runtime.scheduler import Scheduler
from evis.runtime.tap import TapSubscription
from evis.runtime.telemetry import Say, Telemetry, say_in_log
from evis.runtime.wakeup import Wakeup
from evis.runtime.whereabouts import Whereabouts
from msgs.header import Message
from msgs.topics import SYSTEM_TOPICS

IDLE_MS = 50
"""Longest time between two looks at commands, taps and idle hooks."""
LISTEN_S = 0.005
"""Longest time, while there is work, between two looks at who comes and goes on topics that only viewers read."""
Commands = Callable[[], None]


class Executor(Outputs):
    """Runs all nodes of one process of a plan; as `Outputs` it delivers what they publish."""

    def __init__(
        self,
        plan: Plan,
        process: str,
        *,
        request: Callable[[str], None] | None = None,
        tell: Callable[[str, str], None] | None = None,
        redactor: Redactor | None = None,
        say: Say = say_in_log,
    ) -> None:
        """Makes the nodes of a process.

        request: asks the supervisor to start the dormant node of a topic. tell: takes a node's name and a line that is
        for the user's eyes alone; to stderr if not given. redactor: the process's, of the plan's secrets if not given.
        say: takes what nodes say about themselves.
        """
        here = [node.name for node in plan.nodes.values() if node.process == process]
        profile = Profile(Whereabouts(plan.directory, process, here))
        self._redactor = redactor or Redactor(plan.secrets)
        self._request = request
        self._tell = tell or (lambda name, text: print(f"{name}: {text}", file=sys.stderr, flush=True))
        self._context = zmq.Context()
        self._wakeup = Wakeup()
        self.failure = ""
        self._last_idle = 0.0
        wiring = Wiring(plan, process, self._context)
        self._taps = Taps(wiring, self._wakeup)
        self._telemetry = Telemetry(plan, process, self._context, profile, self._redactor, say)
        hosts = wiring.hosts
        begin_contexts(host.node.computes_on() for host in hosts.values())
        scheduler = Scheduler(hosts, profile, self._telemetry, plan.mode == "realtime")
        super().__init__(plan, hosts, profile, scheduler)
        for host in self._hosts.values():
            self.profile.node(host.name).made_elsewhere = host.plan.joins
        self._subscriptions: list[Subscription] = [s for h in self._hosts.values() for s in h.subscriptions]
        self._publishers: list[AnyPublisher] = [p for h in self._hosts.values() for p in h.publishers.values()]
        self._publishers += self._telemetry.publishers.values()
        self._dormant = [host for host in self._hosts.values() if host.plan.dormant]
        self._declared = [publisher for publisher in self._publishers if publisher.declared]
        self._serve_all_at = 0.0
        self._outside_inputs = [self._open_to_outside(host) for host in self._hosts.values() if host.plan.outside]

    def _open_to_outside(self, host: Host) -> OutsideInputs:
        recorded = any(node.target.endswith(":RecorderNode") for node in self.plan.nodes.values())
        host.outside = OutsideInputs(
            host.node,
            host.plan.outside,
            self.plan.directory,
            waits=self.plan.mode == "lockstep",
            now_ns=lambda: self.profile.node(host.name).stamp_ns,
            say=lambda level, text: self.diagnose(host.node, level, text),
            on_control=self._take_singly,
            note="; the bag keeps what comes of its actions, and not the actions" if recorded else "",
        )
        return host.outside

    def _take_singly(self) -> None:
        """Has every node take one stamp at a time, because a program outside waits for what comes of each."""
        for host in self._hosts.values():
            if host.takes_several:
                with NodeCall(self.profile, host.name):
                    host.node.take_singly()

    # -- life --------------------------------------------------------------------------------------------------------

    def setup(self) -> None:
        """Opens the sockets and prepares every node."""
        for outside in self._outside_inputs:
            outside.open()  # who knocks during the set-up is heard before the first step
        for publisher in self._publishers:
            publisher.start()
            self._wakeup.hear(publisher, publisher.sockets())
        for subscription in self._subscriptions:
            subscription.subscriber.start()
        for host in self._hosts.values():
            self._introduce(host)
        # Consumers first: a publisher in the same process may publish its latched topics in setup.
        for host in reversed(self._hosts.values()):
            with NodeCall(None, host.name):
                host.node.setup()
        # The other way round: who began last waits first, and builds what nobody has begun with.
        for host in self._hosts.values():
            with NodeCall(None, host.name):
                host.node.warm_up()

    def _introduce(self, host: Host) -> None:
        """Tells a node its runtime, the run's length, and whether something waits for it or records it."""
        host.node.runtime, host.node.may_gather = self, host.takes_several
        # A program outside waits for nothing before it comes, and then `_take_singly` tells these nodes.
        host.node.may_lag = not self.plan.waits or host.takes_several
        host.node.run_s, host.node.recorded = self.plan.duration_s, self.plan.recorded

    def wait_connected(self, timeout_s: float, commands: Commands | None = None) -> None:
        """Waits until every declared edge of this process is connected. Raises TimeoutError that names who is
        missing."""
        deadline = time.monotonic() + timeout_s
        while (missing := self._missing()) and not self.stopping:
            if time.monotonic() > deadline:
                raise TimeoutError(f"not connected after {timeout_s:g} s: {', '.join(missing)}")
            for s in self._subscriptions:
                self._wakeup.hear(s.subscriber, s.subscriber.signals())  # messages may be there, and stay there
            self._wakeup.wait(10)
            if commands is not None:
                commands()

    def _missing(self) -> list[str]:
        for publisher in self._publishers:
            publisher.pump()
        absent = [f"{consumer} of {p.topic}" for p in self._publishers for consumer in p.missing()]
        return absent + [
            f"the publisher of {s.topic}" for s in self._subscriptions if s.declared and not s.subscriber.connected()
        ]

    def run(self, commands: Commands | None = None) -> None:
        """Runs until every node has ended. `commands` is called at least every IDLE_MS (heartbeat, stop requests)."""
        self._telemetry.start_clock()
        self._scheduler.allow_steps(None)
        try:
            self._run_to_end(commands)
        finally:
            self.close_nodes()

    def _run_to_end(self, commands: Commands | None) -> None:
        while not self._finished():
            if not self._run_turn(commands):
                self._wait()
        self._drain(commands)

    def advance(self) -> bool:
        """Lets every source make one step, and returns when the messages of it have passed through all nodes.

        For a graph that is one process. False once every source has given all that it has; `finish` brings what nodes
        hold back. Raises RuntimeError where a source waits for a message that nobody is going to send.
        """
        self._scheduler.allow_steps(1)
        while True:
            if self._run_turn(None):
                continue
            waiting = self._scheduler.sources_with_steps_left()
            if not waiting:
                return bool(self._scheduler.sources_going_on())
            if not self._subscriptions and not any(0 < self._scheduler.due_s(host) < math.inf for host in waiting):
                due = ", ".join(f"{port} at {stamp} ns" for port, stamp in waiting[0].node.due().items())
                raise RuntimeError(f"{waiting[0].name} waits for {due}, which nobody sends")
            self._wait()

    def finish(self) -> None:
        """Ends the sources of a graph that was stepped by `advance`, and lets every node publish what it has
        held back."""
        self.stop()
        self._scheduler.allow_steps(None)
        self._run_to_end(None)

    def settle(self, act: Callable[[], None]) -> None:
        """Calls `act`, in which a node publishes, and returns when its messages have passed through; no source makes a
        step."""
        self._scheduler.allow_steps(0)
        act()
        while self._run_turn(None):
            pass

    def node(self, name: str) -> Node:
        """Returns a node of this process."""
        return self._hosts[name].node

    def rewind(self, plan: Plan) -> None:
        """Restarts the run at time 0, as if the graph of this plan had just been set up: the same nodes and topics,
        with other parameters where these differ."""
        self.plan = plan
        self._scheduler.stopping = False
        for host in self._hosts.values():
            host.rewind()
        for host in reversed(self._hosts.values()):
            host.plan = plan.nodes[host.name]
            with NodeCall(None, host.name):
                if host.node.rewind(host.plan.params):
                    host.node.restart_totals()
                else:
                    self._replace_node(host)
        self.profile.nodes.clear()
        self._telemetry.start_clock()

    def state(self) -> dict[str, Any]:
        """Gives what the nodes go on from besides the messages of the last stamp, and what they have counted. Raises
        ValueError where one cannot tell."""
        nodes = {host.name: (host.node.state(), host.node.totals()) for host in self._hosts.values()}
        return {"nodes": nodes, "profile": copy.deepcopy(self.profile.nodes)}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Goes on from what `state` gave, once the nodes have had the messages of that stamp after a `rewind`."""
        for name, (own, totals) in state["nodes"].items():
            with NodeCall(None, name):
                self._hosts[name].node.restore(own)
                self._hosts[name].node.restart_totals(totals)
        self.profile.nodes.clear()
        self.profile.nodes.update(copy.deepcopy(state["profile"]))

    def _replace_node(self, host: Host) -> None:
        """Replaces a node that cannot be rewound by a new one, and gives it the latched messages."""
        host.node.close()
        host.node = load_class(host.plan.target)(host.name, host.plan.params)
        self._introduce(host)
        host.node.setup()
        host.node.warm_up()
        for port, topics in host.plan.inputs.items():
            for message, topic in [(self._latched[t], t) for t in topics if t in self._latched]:
                message.keep()
                self._scheduler.accept(host, port, topic, message)

    def _run_turn(self, commands: Commands | None) -> bool:
        """Handles all topics and calls all nodes once; True when a message came or a node was called."""
        progress = False
        if not self.plan.closed:
            with self.profile.inside("bus"):
                self._serve_publishers()
            progress = self._receive()
        for host in self._hosts.values():
            progress |= self._scheduler.call(host)
        self._housekeeping(commands)
        return progress

    def _serve_publishers(self) -> None:
        """Handles what consumers and viewers have sent to the publishers."""
        now, publishers = time.monotonic(), self._declared
        if now >= self._serve_all_at:
            publishers, self._serve_all_at = self._publishers, now + LISTEN_S
        for publisher in publishers:
            publisher.pump()
        for host in self._dormant:
            host.follow_readers()

    @property
    def stopping(self) -> bool:
        """Tells whether `stop` was called."""
        return self._scheduler.stopping

    def _finished(self) -> bool:
        return all(h.ended for h in self._hosts.values()) and all(s.ended for s in self._subscriptions if s.declared)

    def stop(self) -> None:
        """Ends the sources and services of this process; what they have sent still passes through."""
        self._scheduler.stopping = True

    def close_nodes(self) -> None:
        """Closes every node, also after the error of one."""
        failure: NodeFailed | None = None
        for host in self._hosts.values():
            try:
                host.node.close()
            except Exception as error:
                if failure is None:
                    failure = NodeFailed(host.name, error)
                    failure.__cause__ = error
        if failure is not None:
            raise failure

    def close(self) -> None:
        """Closes the sockets."""
        for outside in self._outside_inputs:
            outside.close()
        self._taps.close()
        for subscription in self._subscriptions:
            subscription.subscriber.close()
        for publisher in self._publishers:
            publisher.close()
        self._context.destroy(linger=0)

    def progress(self) -> dict[str, Any]:
        """Returns plain numbers for the heartbeat: newest stamp, events, keyframes, frames so far."""
        nodes = self.profile.nodes.values()
        return {
            "stamp_ns": max((n.stamp_ns for n in nodes), default=0),
            "events": sum(n.events for n in nodes),
            "keyframes": sum(n.keyframes for n in nodes),
            "frames": sum(n.frames for n in nodes),
        }

    def topics_read(self) -> set[str]:
        """Returns the topics of this process's nodes that something reads now."""
        return {topic for h in self._hosts.values() for topic, p in h.publishers.items() if p.wanted()}

    def summary(self) -> dict[str, Any]:
        """Returns the profiles of the nodes, and of `bus` and `idle`."""
        return {name: profile.summary() for name, profile in self.profile.nodes.items()}

    # -- one turn ----------------------------------------------------------------------------------------------------

    def _receive(self) -> bool:
        progress = False
        for outside in self._outside_inputs:
            progress |= outside.pump()
        for s in self._subscriptions:
            if s.ended or not self._scheduler.takes(s.host, s.port):
                continue
            with self.profile.inside("bus"):
                message = s.subscriber.receive(0)
                if message is None:
                    if s.declared:  # a tap may come and go
                        s.subscriber.raise_if_publisher_lost()
                    continue
            progress = True
            if s.host.wants_every:
                s.host.pass_on_losses()
            s.ended = s.declared and message is END
            if message is not END or s.declared:
                self._scheduler.accept(s.host, s.port, s.topic, message)
        return self._taps.pump() or progress

    def _drain(self, commands: Commands | None) -> None:
        """Waits, after the last node, until every consumer has returned its credits (ipc drops what is sent last)."""
        pending = [p for h in self._hosts.values() for p in h.publishers.values()]
        while pending := [p for p in pending if not p.finish(0)]:
            self._housekeeping(commands)
            with self.profile.inside("idle"):
                self._wakeup.wait(IDLE_MS)
        self._telemetry.periodic(self._hosts, force=True)

    def _wait(self) -> None:
        timeout = float(IDLE_MS)
        for host in self._hosts.values():
            timeout = min(timeout, max(1e3 * self._scheduler.due_s(host), 0.0))
        for s in self._subscriptions:
            self._wakeup.hear(s.subscriber, self._sockets_to_poll(s))
        for outside in self._outside_inputs:
            self._wakeup.hear(outside, outside.sockets())
        self._serve_all_at = 0.0  # who wakes it up is heard
        with self.profile.inside("idle"):
            self._wakeup.wait(math.ceil(timeout))

    def _sockets_to_poll(self, s: Subscription) -> Sequence[zmq.Socket | int]:
        """Returns the sockets that `_receive` would read now; one left readable would turn the wait into a busy
        loop."""
        if s.ended:
            return ()
        if self._scheduler.takes(s.host, s.port):
            return s.subscriber.sockets()
        if s.declared:
            s.subscriber.raise_if_publisher_lost()
        return s.subscriber.signals()

    def _housekeeping(self, commands: Commands | None) -> None:
        now = time.monotonic()
        # By half of it: a wait of IDLE_MS that ends a little early must not pass a look over.
        if 1e3 * (now - self._last_idle) < IDLE_MS / 2:
            return
        self._last_idle = now
        for host in self._hosts.values():
            if not host.ended and type(host.node).idle is not Node.idle:
                with NodeCall(self.profile, host.name):
                    host.node.idle()
        self._telemetry.periodic(self._hosts)
        if commands is not None:
            commands()

    # -- what nodes call ---------------------------------------------------------------------------------------------

    def count(self, node: Node, name: str, amount: float) -> None:
        """Implements Node.count."""
        self.profile.node(node.name).counters[name] += amount  # type: ignore[assignment]

    def result(self, node: Node, name: str, value: Any) -> None:
        """Implements Node.result."""
        self.profile.node(node.name).results[name] = value

    def diagnose(self, node: Node, level: str, text: str) -> None:
        """Writes one line to the process's log, and sends one Diagnostics message."""
        self._telemetry.say(self._hosts.get(node.name), node.name, level, text)

    def tell(self, node: Node, text: str) -> None:
        """Implements Node.tell."""
        self._tell(node.name, text)

    def hide(self, secret: str) -> None:
        """Implements Node.hide."""
        self._redactor.add(secret)

    def open_tap(self, node: Node, topic: str, callback: Callable[[Message], None]) -> TapSubscription:
        """Implements Runtime.open_tap. `callback` runs on this thread; arrays are valid while it runs."""
        if topic not in SYSTEM_TOPICS and topic not in self.plan.topics:
            raise ValueError(f"{node.name}: nobody publishes {topic}; there are {', '.join(self.plan.open_topics())}")
        return self._taps.open(node.name, topic, callback)

    def request(self, topic: str) -> None:
        """Asks the supervisor to start the dormant node that publishes `topic`."""
        if self._request is not None:
            self._request(topic)
