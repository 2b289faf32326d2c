"""Tracks which outside program controls a delayed input, and what the node's next step gets from it."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import time
from collections.abc import Callable
from typing import Any

import msgpack

from evis.bus.links import Link, LinkLost
from evis.runtime.outside import ANY_STAMP
from msgs.header import Header, Message

SAY_S = 5.0
"""A wait for the action of one step is told of after this time [s]."""
Say = Callable[[str, str], None]


class ControlledInput:
    """Lets one program at a time control a delayed input from outside.

    In lock-step each step waits for its action, as long as that program has patience; otherwise the latest one holds.
    topic: of the input. say: takes a level and a line. note: goes with the line of who takes control.
    """

    def __init__(self, topic: str, say: Say, note: str = "") -> None:
        self.topic = topic
        self.controller: Link | None = None
        self.controller_name = ""
        self.lockstep = False
        self.refused = 0
        """Actions of this controller that could not be taken."""
        self._say = say
        self._note = note
        self._patience_s = math.inf
        self._pending: Message | None = None
        self._due: int | None = None
        self._waits_since = 0.0
        self._told = False

    def begin_control(self, link: Link, who: str, stamp_ns: int, lockstep: bool, patience_s: float) -> None:
        """Gives control to a program, from a stamp [ns] on. patience_s: longest wait for the action of a step [s]."""
        self.controller, self.controller_name, self.lockstep, self._patience_s = link, who, lockstep, patience_s
        self.refused = 0
        self._due = None
        how = "every step waits for its action" if lockstep else "its latest action holds"
        self._say("info", f"{who} controls {self.topic} from {stamp_ns / 1e9:.6g} s on: {how}{self._note}")

    def end_control(self, stamp_ns: int, why: str, level: str = "info") -> None:
        """Takes control from its controller; its last action is still done, and stays in effect.

        stamp_ns: of the state that the node published last [ns].
        """
        self._say(level, f"{self.controller_name} {why}; from {stamp_ns / 1e9:.6g} s on its last action holds")
        self.controller, self._due = None, None

    def mistimed(self, stamp_ns: int, now_ns: int) -> str:
        """Returns why an action of this stamp is too late or too early; "" where it is neither.

        now_ns: stamp of the state that the node published last [ns].
        """
        wanted = now_ns if self._due is None else self._due
        if stamp_ns == ANY_STAMP or stamp_ns == wanted:
            return ""
        text = f"an action for {stamp_ns / 1e9:.9g} s is "
        if stamp_ns < wanted:
            return f"{text}late: the next step starts at {wanted / 1e9:.9g} s"
        return f"{text}too early: the next step starts at {wanted / 1e9:.9g} s"

    def put(self, message: Message) -> None:
        """Stores an action, in place of one that no step has used yet."""
        self._pending = message

    def waits(self, stamp_ns: int) -> bool:
        """Tells whether the step that starts at this stamp must wait for its action."""
        if self.controller is None or not self.lockstep or self._pending is not None:
            return False
        now = time.monotonic()
        if self._due != stamp_ns:
            self._due, self._waits_since, self._told = stamp_ns, now, False
            answer(self.controller, op="due", stamp_ns=stamp_ns)
        waited = now - self._waits_since
        if waited > self._patience_s:
            why = f"gave no action for {self._patience_s:g} s and lost {self.topic}"
            answer(self.controller, op="lost", why=f"it {why}, at {stamp_ns / 1e9:.6g} s")
            self.end_control(stamp_ns, why, "warning")
            return False
        if waited > SAY_S and not self._told:
            self._told = True
            self._say("warning", f"the step at {stamp_ns / 1e9:.6g} s waits for its action from {self.controller_name}")
        return True

    def action(self, stamp_ns: int) -> Message | None:
        """Returns the new action for the step that starts at this stamp; it stays until `done`."""
        if self._pending is None:
            return None
        return dataclasses.replace(self._pending, header=Header(stamp_ns))  # type: ignore[type-var]

    def done(self) -> None:
        """Removes the action that the last step has used."""
        self._pending, self._due = None, None


def answer(link: Link, **fields: Any) -> None:
    """Sends one answer, if the program is there and reads it; otherwise closes its link behind what it has sent."""
    with contextlib.suppress(LinkLost):
        link.send([msgpack.packb(fields)])
