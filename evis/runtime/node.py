"""Defines a node: declared parameters, inputs and outputs (declaration.py) around a pure part.

A node never sees a socket. The executor (executor.py) gives it the messages of its inputs, joined by stamp, and
carries away what it publishes, whether the other end is in this process, another one, or another machine.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from evis.config.params import EACH, resolve
from evis.runtime.declaration import Declaration
from evis.runtime.declaration import Input as Input
from evis.runtime.declaration import Output as Output
from msgs.header import Message

if TYPE_CHECKING:
    from evis.runtime.plan import Plan
    from evis.runtime.tap import TapSubscription


_SHARE = re.compile(r"share\d+")
"""Prefix of the name of a node's copy for a share of the environments."""
Arrays = Mapping[str, tuple[tuple[int, ...], Any]]
"""Arrays wanted of a loan: name -> (shape, dtype)."""


class Runtime(Protocol):
    """Defines what the process does for its nodes; a node reaches most of it by its own methods."""

    plan: Plan
    failure: str
    """What ended the graph before its time, in one line, as far as a node that outlives it can know; else empty."""

    def wants(self, node: Node, port: str, array: str = "") -> bool:
        """Tells whether something reads an output now, or an array of its messages."""

    def gathered(self, node: Node, port: str) -> int:
        """Returns how many messages of an output the nodes of this process wait for."""

    def loan(self, node: Node, port: str, arrays: Arrays) -> dict[str, np.ndarray]:
        """Lends arrays to write an output's next message into."""

    def loan_on(self, node: Node, port: str, device: Any, arrays: Arrays) -> dict[str, Any]:
        """Lends arrays on a device to write an output's next message into."""

    def loan_for_readers(self, node: Node, port: str, device: Any, arrays: Arrays) -> dict[str, Any]:
        """Lends arrays to write an output's next message into, on the host where it is read only there."""

    def lending(self, node: Node, port: str) -> AbstractContextManager[None]:
        """Lets messages of all outputs lie in the loans of one."""

    def publish(self, node: Node, port: str, message: Message) -> None:
        """Sends a message on an output."""

    def publish_all(self, node: Node, port: str, messages: Sequence[Message]) -> None:
        """Sends messages on an output, which consumers in this process may take at once."""

    def count(self, node: Node, name: str, amount: float) -> None:
        """Adds to a counter of the node."""

    def result(self, node: Node, name: str, value: Any) -> None:
        """Puts a result of the node into the run's summary."""

    def diagnose(self, node: Node, level: str, text: str) -> None:
        """Writes one line to the process's log, and sends it as one Diagnostics message."""

    def tell(self, node: Node, text: str) -> None:
        """Shows one line to the user alone."""

    def hide(self, secret: str) -> None:
        """Keeps a secret out of logs and diagnostics from now on."""

    def open_tap(self, node: Node, topic: str, callback: Callable[[Message], None]) -> TapSubscription:
        """Subscribes a topic of the running graph, lossily."""

    def request(self, topic: str) -> None:
        """Asks the supervisor to start the dormant node that publishes a topic."""


def with_others(text: str, others: Sequence[str]) -> str:
    """Adds to a node's line the names of the nodes for which it holds too."""
    return f"{text} (the same in {', '.join(others)})" if others else text


class Node(Declaration):
    """Connects a pure part with the graph; the base class of all nodes.

    Life: `__init__`, `setup`, `warm_up`, then `update`/`receive`/`step` by the executor, `finish`, `close`.

    `setup` and `warm_up` do the slow things (imports, kernel compilation, opening files); the graph starts when both
    are over for every node. An exception ends the graph with the node's name and the text; raise ValueError or OSError
    with one clear line.
    """

    told_by: str = ""
    tells_for: Sequence[str] = ()
    """As of NodePlan; set by who makes the nodes of a plan."""
    gathers: int = 1
    """Stamps that it waits for, to take them at once by `update_all`; more than 1 only where it `may_gather`."""
    may_gather: bool = False
    """Whether `update_all` is called, for nobody waits for what comes of a single stamp (`Plan.single`) until
    `take_singly`; set by the executor before setup."""
    may_lag: bool = False
    """Whether what comes of a stamp may be published when the next one is under way, for nobody waits for it
    (`Plan.waits`), or not until `take_singly`; set by the executor before setup."""
    run_s: float | None = None
    """How long the run is to take, in stamps [s], None = until its sources end; set by the executor before setup."""
    recorded: bool = False
    """Whether a recorder takes what comes of the run (`Plan.recorded`); set by the executor before setup."""

    def __init__(self, name: str, params: Mapping[str, Any]) -> None:
        """Takes the name and the parameters: those of PARAMS, and perhaps EACH, which a graph that is held in Python
        may have."""
        self.name = name
        shared = {key: value for key, value in params.items() if key != EACH}
        self.params = resolve(name, self.PARAMS, shared) | ({EACH: params[EACH]} if EACH in params else {})
        self.runtime: Runtime  # set by the executor before setup
        self._totals: dict[str, float] = {}

    def below(self, name: str) -> str:
        """Returns a name below the namespace that a launch file puts the node in: `robot/cam0`, or `cam0` without."""
        return "/".join((*(part for part in self.name.split("/")[:-1] if not _SHARE.fullmatch(part)), name))

    # -- what the executor calls -------------------------------------------------------------------------------------

    def computes_on(self) -> str:
        """Returns the Warp device that this node is sure to need, so that it is made ready early; "" = none."""
        return ""

    def setup(self) -> None:
        """Prepares the node; latched outputs (CameraInfo) are published here."""

    def warm_up(self) -> None:
        """Prepares for the first message, after `setup` of all nodes of the process.

        Kernels that one node has begun to build are so built while the others set up.
        """

    def due(self) -> Mapping[str, int]:
        """Returns the delayed inputs that a source's next step needs, with the stamps [ns] that they must have."""
        return {}

    def offer(self, port: str) -> Mapping[str, Any]:
        """Describes, in plain values, what a program outside may give to a port with `outside`.

        Raises ValueError saying why it can give nothing.
        """
        return {}

    def admit(self, port: str, message: Message) -> None:
        """Raises ValueError, in one line, for a message from outside that this node cannot take.

        `receive`, which then gets it unless it closes a loop, may raise one too.
        """

    def step(self, inputs: Mapping[str, Message]) -> bool:
        """Publishes a source's next messages; returns False when there are no more."""
        raise TypeError(f"{type(self).__name__} is not a source")

    def update(self, inputs: Mapping[str, Message]) -> None:
        """Processes one message per connected joined input, all of one stamp. Arrays are valid until return unless
        kept."""
        raise TypeError(f"{type(self).__name__} takes no joined inputs")

    def update_all(self, inputs: Sequence[Mapping[str, Message]]) -> None:
        """Processes the inputs of several stamps, one after another, and publishes what `update` would publish for
        each.

        These are all that are there, and no fewer than `gathers` unless no more will come.
        """
        for one in inputs:
            self.update(one)

    def take_singly(self) -> None:
        """Takes one stamp at a time from now on, and publishes what comes of it before the next one, because somebody
        waits for that; also what is still to come of those before."""
        self.gathers, self.may_lag = 1, False

    def receive(self, port: str, message: Message) -> None:
        """Processes a message of an input that is not joined, or of a latched topic.

        A source publishes nothing here: it is called also while there is no room for its outputs.
        """
        raise TypeError(f"{type(self).__name__} takes no single inputs")

    def finish(self) -> None:
        """Publishes what is left, after all inputs have ended."""

    def rewind(self, params: Mapping[str, Any]) -> bool:
        """Brings the node into its state after `setup` with these parameters, for another run from time 0.

        False, unless a subclass knows how: then a new node takes its place. What `setup` has published stays published.
        """
        return False

    def state(self) -> Any:
        """Gives what the node goes on from besides the messages of the last stamp, as copies: None where that is
        nothing.

        Raises ValueError, unless a subclass knows how, in one line that says what cannot be kept.
        """
        raise ValueError(
            f"{self.name} ({type(self).__name__}) does not tell what it goes on from; leave it out, or give its class "
            "state() and restore()"
        )

    def restore(self, state: Any) -> None:
        """Goes on from what `state` gave, after a `rewind` and the messages of the stamp at which it did."""

    def idle(self) -> None:
        """Does a node's work besides messages; called on the executor's thread at least every 50 ms."""

    def close(self) -> None:
        """Releases devices and files; called once, also after an error."""

    # -- what a node uses --------------------------------------------------------------------------------------------

    def wants(self, port: str, array: str = "") -> bool:
        """Tells whether something reads this output; False for a port that the planner left out.

        array: whether somebody reads that one of its messages' arrays, as `reads` tells; viewers read all.
        """
        return self.runtime.wants(self, port, array) if array else self.runtime.wants(self, port)

    def gathered(self, port: str) -> int:
        """Returns how many messages of an output the nodes of this process wait for, to take them at once
        (`gathers`)."""
        return self.runtime.gathered(self, port)

    def loan(self, port: str, **arrays: tuple[tuple[int, ...], Any]) -> dict[str, np.ndarray]:
        """Returns arrays to write this port's next message into, name -> (shape, dtype); sending makes no copy."""
        return self.runtime.loan(self, port, arrays)

    def loan_on(self, port: str, device: Any, **arrays: tuple[tuple[int, ...], Any]) -> dict[str, Any]:
        """Returns Warp arrays as `loan` does, name -> (shape, Warp dtype), where [E, H, W] of vec3 is [E, H, W, 3].

        They are copied to the host only for readers that need them there. What writes them is launched on Warp's stream
        of the device; nobody need wait for it before `publish`.
        """
        return self.runtime.loan_on(self, port, device, arrays)

    def loan_for_readers(self, port: str, device: Any, **arrays: tuple[tuple[int, ...], Any]) -> dict[str, Any]:
        """Returns arrays as `loan_on` does, or numpy's, in memory that the device writes to fast, where there are
        readers and all of them read on the host. What writes numpy's must be done before `publish`.
        """
        return self.runtime.loan_for_readers(self, port, device, arrays)

    def lending(self, port: str) -> AbstractContextManager[None]:
        """Lets messages published within the block, on any output, lie in loans made of this one before it.

        Who keeps one of them holds the loan.
        """
        return self.runtime.lending(self, port)

    def tell(self, text: str) -> None:
        """Shows one line to the user alone: it goes to no log, no topic and no bag."""
        self.runtime.tell(self, text)

    def hide(self, secret: str) -> None:
        """Keeps a secret that this node has made for itself out of logs and diagnostics."""
        self.runtime.hide(secret)

    def publish(self, port: str, message: Message) -> None:
        """Sends a message on an output; blocks while a declared consumer is behind. Fills header.seq."""
        self.runtime.publish(self, port, message)

    def count(self, name: str, amount: float = 1) -> None:
        """Adds to a counter shown in /diagnostics and in the run's summary (drops, clips, non-finite values, ...)."""
        self.runtime.count(self, name, amount)

    def publish_all(self, port: str, messages: Sequence[Message]) -> None:
        """Sends messages of ascending stamps, as `publish` does one by one, and lets the consumers of this process take
        them at once. Their arrays may lie in one loan.
        """
        self.runtime.publish_all(self, port, messages)

    def result(self, name: str, value: Any) -> None:
        """Puts a result of the run, plain values, into its summary under a name of its own; the last one counts."""
        self.runtime.result(self, name, value)

    def count_total(self, name: str, total: float) -> bool:
        """Adds to a counter what a running total has gained since the last call.

        True when that is the first time that the total is not 0, for a warning that is said once. A total that falls
        takes away what it lost, so that a gauge (a temperature) can be shown too.
        """
        last = self._totals.get(name, 0)
        if total == last:
            return False
        self.count(name, total - last)
        first = name not in self._totals
        self._totals[name] = total
        return first

    def totals(self) -> dict[str, float]:
        """Gives the running totals that `count_total` has seen last."""
        return dict(self._totals)

    def restart_totals(self, totals: Mapping[str, float] | None = None) -> None:
        """Sets all running totals back to 0, or to what they were; what was counted stays in the node's counters."""
        self._totals = dict(totals or {})

    def warn_alike(self, text: str) -> None:
        """Gives a warning that holds for all nodes alike (see `alike`): one of them gives it, and names the others."""
        if not self.told_by:
            self.warn(with_others(text, self.tells_for))

    def warn(self, text: str) -> None:
        """Gives one warning line in the log and on /diagnostics."""
        self.runtime.diagnose(self, "warning", text)
