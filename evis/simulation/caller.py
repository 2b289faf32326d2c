"""Implements the node that stands for the caller in the graph: it takes what was asked for, and publishes the caller's
actions."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from evis.config.params import Param
from evis.runtime.node import Input, Node, Output
from evis.simulation.output_names import STATE
from evis.simulation.outputs import RequestedOutputs
from msgs.camera import EventPacket, Image
from msgs.header import Header, Message
from msgs.world import Action, WorldState


class CallerNode(Node):
    """Keeps what arrives until the caller takes it; the caller publishes through it."""

    PARAMS: ClassVar[Mapping[str, Param]] = {
        "topics": Param(list, [], "globs of the topics that the caller takes"),
        "acts": Param(bool, False, "the caller publishes actions"),
        "device": Param(str, "cpu", "where arrays may stay: cpu, cuda, cuda:1"),
    }
    INPUTS: ClassVar[Mapping[str, Input]] = {"messages": Input("*", join=False, on_device=True)}
    OUTPUTS: ClassVar[Mapping[str, Output]] = {"action": Output("/action")}

    @classmethod
    def dynamic_inputs(cls, params: Mapping[str, Any], available: Iterable[str]) -> list[str]:
        """Lists the topics that were asked for, and /state, which tells the time. Raises ValueError."""
        names = list(available)
        found = RequestedOutputs(tuple(params["topics"]), ()).topics(names)
        return list(dict.fromkeys([*found, *([STATE] if STATE in names else [])]))

    @classmethod
    def dynamic_outputs(cls, params: Mapping[str, Any]) -> Mapping[str, Output]:
        """Gives the actions, where the caller has something to move."""
        return cls.OUTPUTS if params["acts"] else {}

    @classmethod
    def reads(cls, params: Mapping[str, Any], port: str) -> frozenset[str] | None:
        """Names the one array that is read of states which were not asked for: where the bodies are."""
        if port == STATE and not any(fnmatch.fnmatchcase(port, glob) for glob in params["topics"]):
            return frozenset({"end_pose"})
        return None

    def setup(self) -> None:
        """Begins with nothing taken."""
        self.taken: dict[str, list[Message]] = {}
        """Topic -> its last message; of images, which come at their own rate, all."""
        self._asked_for: dict[str, bool] = {}
        """Topic -> whether the caller wants its messages, or only to know how far the run is."""
        self.stamp_ns = 0
        """The latest stamp that arrived."""
        self.episodes: np.ndarray | None = None
        """Of the last state, int32 [E]."""
        self.envs = 1
        """How many environments the messages have, as states and events tell it."""
        self.poses: np.ndarray | None = None
        """Of its bodies, float64 [E, N, 7]."""
        self.own: np.ndarray | None = None
        """Its rows of msgs.own_time, int64 [E, 4]; None where all environments were reset together."""

    def rewind(self, params: Mapping[str, Any]) -> bool:
        """Forgets what was not taken."""
        self.take()
        self.setup()
        return dict(params) == self.params

    def state(self) -> None:
        """Gives nothing: all that has arrived was taken."""

    def receive(self, port: str, message: Message) -> None:
        """Keeps a message of topic `port`; the arrays stay as they are until `take`."""
        if isinstance(message, WorldState):
            self.episodes, self.poses = np.array(message.episodes), message.kept_end_pose()
            self.own = None if message.own is None else np.array(message.own)
            self.envs = len(self.episodes)
        elif isinstance(message, EventPacket):
            self.envs = len(message.env_offsets) - 1
        self.stamp_ns = max(self.stamp_ns, message.header.stamp_ns)
        if port not in self._asked_for:
            self._asked_for[port] = any(fnmatch.fnmatchcase(port, glob) for glob in self.params["topics"])
        if not self._asked_for[port]:
            return
        message.keep()
        before = self.taken.get(port, [])
        if isinstance(message, Image):
            # There are any number of them in a step, and a topic lends a bounded number of slots.
            message = owned(message)
        elif before:
            before.pop().release()
        self.taken[port] = [*before, message]

    def take(self) -> dict[str, list[Message]]:
        """Hands over what has arrived, topic -> messages, whose arrays are the caller's own from now on."""
        taken, self.taken = self.taken, {}
        return {topic: [self._placed(owned(message)) for message in found] for topic, found in taken.items()}

    def _placed(self, message: Message) -> Message:
        """Brings the columns of events to the device: those of a packet without any are made on the host."""
        if self.params["device"] == "cpu" or not (
            isinstance(message, EventPacket) and isinstance(message.t, np.ndarray)
        ):
            return message
        import warp as wp

        columns: dict[str, Any] = {
            name: wp.array(array, device=self.params["device"])
            for name in ("t", "x", "y", "p", "c")
            if (array := getattr(message, name)) is not None
        }
        return replace(message, **columns)

    def act(self, stamp_ns: int, controls: np.ndarray) -> None:
        """Publishes controls float64 [E, nu] for the step that starts at a stamp."""
        self.publish("action", Action(Header(stamp_ns), controls=controls))


def owned(message: Message) -> Message:
    """Gives a kept message whose arrays nobody will write again, and ends the keeping.

    Memory that nobody else holds is taken out of its topic's pool, and nothing is copied; other arrays are.
    """
    slot = message._slot
    if slot is None:
        # Physics goes on from states that it has published.
        every = isinstance(message, WorldState)
        arrays = {name: a for name, a in message.arrays().items() if isinstance(a, np.ndarray)}
        shared = {name: a for name, a in arrays.items() if every or not a.flags.writeable}
        return _with(message, {name: array.copy() for name, array in shared.items()})
    pool = getattr(slot, "pool", None)
    if slot.pins == 1 and pool is not None:
        pool.part_with(slot)
        message._slot = None  # type: ignore[misc]
        return message
    copy = _with(message, {name: _copied(value) for name, value in message.arrays().items()})
    message.release()
    return copy


def _with(message: Message, arrays: Mapping[str, Any]) -> Message:
    """Makes the message with these arrays in place of its own."""
    whole: Any = message
    changed: Message = replace(whole, **arrays)
    return changed


def _copied(array: Any) -> Any:
    """Makes a copy on the array's own device."""
    if isinstance(array, np.ndarray):
        return array.copy()
    import warp as wp

    return wp.clone(array)
