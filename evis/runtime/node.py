"""What a node is: declared parameters, inputs and outputs around a pure part.

A node never sees a socket. The executor (executor.py) gives it the messages of its inputs, joined by stamp, and
carries away what it publishes, whether the other end is in this process, another one, or another machine.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from evis.config.params import Param, resolve
from msgs.header import Message

if TYPE_CHECKING:
    from evis.runtime.executor import Executor


@dataclass(frozen=True)
class Input:
    """A port that messages come in by.

    topic: name with parameters in braces, `/{camera}/keyframe`; `*` only for nodes that take whatever they are told
    (the recorder). join: delivered by `update`, together with the other joined inputs of the same stamp; otherwise,
    and for latched topics, each message comes by itself to `receive`. delayed: closes a loop (/action); a source asks
    for it by stamp in `due`. on_device: arrays that a node of the same process has on the device which this node's
    parameter `device` names may come as they are, Warp's and not numpy's.
    """

    topic: str
    join: bool = True
    delayed: bool = False
    on_device: bool = False


@dataclass(frozen=True)
class Output:
    """A port that messages leave by. topic as in Input."""

    topic: str


class Node:
    """Base of all nodes. Life: `__init__`, `setup`, then `update`/`receive`/`step` by the executor, `finish`, `close`.

    `setup` does the slow things (imports, kernel compilation, opening files); the graph starts when every node's setup
    is over. An exception ends the graph with the node's name and the text; raise ValueError or OSError with one clear
    line.
    """

    PARAMS: ClassVar[Mapping[str, Param]] = {}
    INPUTS: ClassVar[Mapping[str, Input]] = {}
    OUTPUTS: ClassVar[Mapping[str, Output]] = {}
    BRINGS: ClassVar[Mapping[str, Mapping[Any, Mapping[str, Any]]]] = {}
    """Parameter -> one of its values -> arguments of a launch file whose default it brings, with that default."""
    SOURCE: ClassVar[bool] = False
    """A source is driven by `step` and not by its inputs."""

    def __init__(self, name: str, params: Mapping[str, Any]) -> None:
        self.name = name
        self.params = resolve(name, self.PARAMS, params)
        self.runtime: Executor  # set by the executor before setup

    # -- what the planner asks, before anything is constructed -------------------------------------------------------

    @classmethod
    def needs(cls, params: Mapping[str, Any], wanted: frozenset[str]) -> frozenset[str]:
        """Input ports needed to make the wanted output ports; all of them unless a subclass knows better."""
        return frozenset(cls.INPUTS)

    @classmethod
    def reads(cls, params: Mapping[str, Any], port: str) -> frozenset[str] | None:
        """Arrays of an input's messages that may be left out elsewhere, of which this node needs just these.

        None, unless a subclass knows better: all that there are. See `wants`.
        """
        return None

    @classmethod
    def imports(cls, params: Mapping[str, Any]) -> Mapping[str, str]:
        """Heavy packages that these parameters leave out, with the reason: {"mujoco": "scene has no dynamics"}."""
        return {}

    @classmethod
    def without_effect(cls, params: Mapping[str, Any]) -> Mapping[str, str]:
        """Parameters that change nothing beside these others, with the reason; who gives one is told so."""
        return {}

    @classmethod
    def random(cls, params: Mapping[str, Any]) -> tuple[str, ...]:
        """What the parameter `seed` decides beside these others, in words; nothing: every seed gives the same."""
        return ()

    @classmethod
    def sensor(cls, params: Mapping[str, Any]) -> Mapping[str, Any]:
        """Parameters for the readers of its camera's CameraInfo, of a node that is that camera's sensor."""
        return {}

    @classmethod
    def divides(cls, params: Mapping[str, Any]) -> int:
        """How many updates there are to each message published; of a source, how many steps to a delayed input.

        Raises ValueError for parameters that do not go together.
        """
        return 1

    # -- what the executor calls -------------------------------------------------------------------------------------

    def setup(self) -> None:
        """Prepare; latched outputs (CameraInfo) are published here."""

    def due(self) -> Mapping[str, int]:
        """Sources: the delayed inputs that the next step needs, and the stamps [ns] they must have."""
        return {}

    def step(self, inputs: Mapping[str, Message]) -> bool:
        """Sources: publish what comes next; False when there is nothing more."""
        raise TypeError(f"{type(self).__name__} is not a source")

    def update(self, inputs: Mapping[str, Message]) -> None:
        """One message per connected joined input, all of one stamp. Arrays are valid until return unless kept."""
        raise TypeError(f"{type(self).__name__} takes no joined inputs")

    def receive(self, port: str, message: Message) -> None:
        """A message of an input that is not joined, or of a latched topic."""
        raise TypeError(f"{type(self).__name__} takes no single inputs")

    def finish(self) -> None:
        """All inputs have ended; publish what is left."""

    def idle(self) -> None:
        """Called on the executor's thread at least every 50 ms, for nodes with something to do besides messages."""

    def close(self) -> None:
        """Release devices and files; called once, also after an error."""

    # -- what a node uses --------------------------------------------------------------------------------------------

    def wants(self, port: str, array: str = "") -> bool:
        """True while somebody reads this output; False for a port that the planner left out.

        array: whether somebody reads that one of its messages' arrays, as `reads` tells; viewers read all.
        """
        return self.runtime.wants(self, port, array) if array else self.runtime.wants(self, port)

    def loan(self, port: str, **arrays: tuple[tuple[int, ...], Any]) -> dict[str, np.ndarray]:
        """Arrays to write this port's next message into, name -> (shape, dtype); no copy is made when it is sent."""
        return self.runtime.loan(self, port, arrays)

    def loan_on(self, port: str, device: Any, **arrays: tuple[tuple[int, ...], Any]) -> dict[str, Any]:
        """As `loan`, on a device: Warp arrays, name -> (shape, Warp dtype), where [E, H, W] of vec3 is [E, H, W, 3].

        They are copied to the host only for readers that need them there. What writes them is launched on Warp's stream
        of the device; nobody need wait for it before `publish`.
        """
        return self.runtime.loan_on(self, port, device, arrays)

    def tell(self, text: str) -> None:
        """Say one line to the user alone: it goes to no log, no topic and no bag."""
        self.runtime.tell(self, text)

    def hide(self, secret: str) -> None:
        """Keep a secret that this node has made for itself out of logs and diagnostics."""
        self.runtime.hide(secret)

    def publish(self, port: str, message: Message) -> None:
        """Send a message on an output; blocks while a declared consumer is behind. Fills header.seq."""
        self.runtime.publish(self, port, message)

    def count(self, name: str, amount: float = 1) -> None:
        """Add to a counter shown in /diagnostics and in the run's summary (drops, clips, non-finite values, ...)."""
        self.runtime.count(self, name, amount)

    def warn(self, text: str) -> None:
        """One warning line in the log and on /diagnostics."""
        self.runtime.diagnose(self, "warning", text)
