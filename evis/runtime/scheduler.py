"""Calls the nodes of one process when their messages and their turn have come, and ends them.

Nodes of one process call each other directly, depth first: what one publishes is accepted for the next, which is called
at once where it is ready. A node is called only while every topic that it, or a node it calls, publishes to another
process has credit, so no wait inside a node can close a circle of waits between processes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from evis.bus import END
from evis.runtime.hosting.host import Host
from evis.runtime.hosting.node_call import NodeCall
from evis.runtime.pacing import Pacer
from evis.runtime.profile import Profile
from evis.runtime.telemetry import Telemetry


class Scheduler:
    """Decides which node of one process is called next, and calls it. `stopping`: sources and services are to end."""

    def __init__(self, hosts: Mapping[str, Host], profile: Profile, telemetry: Telemetry, realtime: bool) -> None:
        """Takes the nodes of a process. realtime: sources are delayed so that stamps follow the wall clock."""
        self.stopping = False
        self._granted: set[str] | None = None
        self._hosts = hosts
        self._profile = profile
        self._telemetry = telemetry
        self._realtime = realtime

    def allow_steps(self, steps: int | None) -> None:
        """Lets every source that has not ended make one step from now on (1), none (0), or any number (None)."""
        self._granted = None if steps is None else {h.name for h in self.sources_going_on()} if steps else set()

    def sources_going_on(self) -> list[Host]:
        """Lists the sources that have more to give."""
        return [h for h in self._hosts.values() if h.node.SOURCE and not h.ended and not h.spent]

    def sources_with_steps_left(self) -> list[Host]:
        """Lists the sources that have not made the step that they were granted."""
        return [self._hosts[name] for name in self._granted or ()]

    @staticmethod
    def takes(host: Host, port: str) -> bool:
        """Tells whether a port takes a message now: a queue always, as the window bounds it; a source too, which
        publishes by its steps alone, as who sends the message may be who has to read before there is credit; a call
        of another node if it has credit."""
        always = host.ended or host.node.SOURCE or port in host.join.queues or port in host.delayed
        return always or host.has_credit()

    def accept(self, host: Host, port: str, topic: str, message: Any) -> None:
        """Takes over one message (with one pin), or the end of a topic, for a port."""
        if host.ended and message is not END:
            message.release()
        elif port in host.join.queues:
            if message is END:
                host.join.end(port)
            else:
                host.join.put(port, message)
        elif port in host.delayed:
            if message is not END:
                # The last of a stamp counts, such as that which answers a reset.
                if (replaced := host.delayed[port].get(message.header.stamp_ns)) is not None:
                    replaced.release()
                host.delayed[port][message.header.stamp_ns] = message
        elif message is END:
            host.open_unjoined.discard(topic)
            host.unseen_latched.discard(topic)
        else:
            try:
                with NodeCall(self._profile, host.name) as profile:
                    host.node.receive(topic if host.node.INPUTS[port].topic == "*" else port, message)
                    profile.updates += 1
                host.unseen_latched.discard(topic)
            finally:
                message.release()

    def call(self, host: Host) -> bool:
        """Calls a node with what is ready for it; True when it was called. Never from within itself."""
        if host.ended or host.active:
            return False
        host.active = True
        try:
            return self._step(host) if host.node.SOURCE else self._update(host)
        finally:
            host.active = False

    def _update(self, host: Host) -> bool:
        progress = self._update_all(host) if host.takes_several else False
        while not host.takes_several and not host.unseen_latched and host.join.ready() and host.has_credit():
            inputs = host.join.take()
            try:
                with NodeCall(self._profile, host.name) as profile:
                    host.node.update(inputs)
                    profile.updates += 1
            finally:
                for message in inputs.values():
                    message.release()
            progress = True
        if self._over(host) and host.has_credit():
            self._end(host)
            progress = True
        return progress

    def _update_all(self, host: Host) -> bool:
        progress = False
        while not host.unseen_latched and host.has_credit() and (found := host.join.gather(host.node.gathers)):
            try:
                with NodeCall(self._profile, host.name) as profile:
                    host.node.update_all(found)
                    profile.updates += len(found)
            finally:
                for inputs in found:
                    for message in inputs.values():
                        message.release()
            progress = True
        return progress

    def _over(self, host: Host) -> bool:
        if host.service:
            return self.stopping and all(h.ended for h in self._hosts.values() if not h.service)
        return host.inputs_over()

    def _step(self, host: Host) -> bool:
        if not host.has_credit():
            return False
        if self.stopping:
            self._end(host)
            return True
        if self._granted is not None and host.name not in self._granted:
            return False
        inputs = host.delayed_inputs()
        if inputs is None or (host.pacer and host.pacer.wait_s(self._stamp(host)) > 0):
            return False
        try:
            with NodeCall(self._profile, host.name) as profile:
                alive = host.node.step(inputs)
                profile.updates += 1
                if alive is None:  # a forgotten return would end the run after one step, without a word
                    raise ValueError("step returned None; it returns True, or False when there is nothing more")
        finally:
            host.release_delayed(inputs)
        if self._granted is not None:
            self._granted.discard(host.name)
        if self._realtime:
            self._pace(host)
        self._telemetry.tick(host)
        if not alive:
            self._exhaust(host)
        return True

    def _exhaust(self, host: Host) -> None:
        """Ends a source that has nothing more to give; the last one of a graph that is stepped stays, for what nodes
        hold back comes once that is asked for."""
        host.spent = True
        if self._granted is None or self.sources_going_on():
            self._end(host)

    def due_s(self, host: Host) -> float:
        """Returns the seconds until a paced source is to be called; infinite for a node without a pace."""
        if host.pacer is None or host.ended:
            return math.inf
        return host.pacer.wait_s(self._stamp(host))

    def _stamp(self, host: Host) -> int:
        return self._profile.node(host.name).stamp_ns

    def _pace(self, host: Host) -> None:
        if host.pacer is None:
            host.pacer = Pacer()
        host.pacer.passed(self._stamp(host))
        profile = self._profile.node(host.name)
        profile.counters["late_ms_max"] = host.pacer.late_ms_max
        profile.results["pace"] = host.pacer.result()

    def _end(self, host: Host) -> None:
        with NodeCall(self._profile, host.name):
            host.node.finish()
        counters = self._profile.node(host.name).counters
        if unmatched := host.join.skipped + host.join.drop_rest():
            counters["unmatched_inputs"] += unmatched
        host.ended = True
        for publisher in host.publishers.values():
            publisher.finish(0)
        for consumer, port, topic in host.downstream:
            self.accept(consumer, port, topic, END)
