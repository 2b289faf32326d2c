"""Declares nodes: parameters, inputs and outputs, and what a launch asks of a class before a node of it is made."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from evis.config.params import Param
from msgs.topics import find_topic

ANY = "*"
"""The topic of a port that takes whatever it is told."""


@dataclass(frozen=True)
class Input:
    """Declares a port that messages come in by.

    topic: name with parameters in braces, `/{camera}/keyframe`; `*` only for nodes that take whatever they are told
    (the recorder). join: delivered by `update`, together with the other joined inputs of the same stamp; otherwise,
    and for latched topics, each message comes by itself to `receive`. delayed: closes a loop (/action); a source asks
    for it by stamp in `due`. optional: left out where nobody publishes it; it may close a loop, for nobody waits for
    its messages. outside: a program outside the running graph may give it (outside/) where no node of the graph
    publishes it. on_device: arrays that a node of the same process has on the device which this node's parameter
    `device` names may come as they are, Warp's and not numpy's.
    """

    topic: str
    join: bool = True
    delayed: bool = False
    outside: bool = False
    optional: bool = False
    on_device: bool = False

    @property
    def needed(self) -> bool:
        """Tells whether the node cannot run without it."""
        return not (self.delayed or self.optional or self.outside)

    def joins(self, topic: str) -> bool:
        """Tells whether messages of a topic come with those of other inputs, by `update`. topic: what it reads."""
        return self.join and not self.delayed and self.topic != ANY and not find_topic(topic).latched


@dataclass(frozen=True)
class Output:
    """Declares a port that messages leave by. topic as in Input.

    late: who comes while the graph runs may have it; otherwise it is made only where a node reads it from the start.
    """

    topic: str
    late: bool = True


class Declaration:
    """Declares a class of nodes; the base class of all declarations, and of Node.

    A node whose declaration is long has it in a file of its own, `declaration.py`, beside `node.py`.
    """

    PARAMS: ClassVar[Mapping[str, Param]] = {}
    INPUTS: ClassVar[Mapping[str, Input]] = {}
    OUTPUTS: ClassVar[Mapping[str, Output]] = {}
    BRINGS: ClassVar[Mapping[str, Mapping[Any, Mapping[str, Any]]]] = {}
    """Parameter -> one of its values -> arguments of a launch file whose default it brings, with that default."""
    SOURCE: ClassVar[bool] = False
    """A source is driven by `step` and not by its inputs."""
    REMEDY: ClassVar[str] = ""
    """How a source whose outputs depend on what it is given comes to publish `{topic}`; "" where they do not."""
    PER_ENVIRONMENT: ClassVar[bool] = False
    """What it publishes of environment k depends on its inputs' environment k and on seed + k alone, so that several of
    it, on devices of their own, may share the environments."""

    @classmethod
    def needs(cls, params: Mapping[str, Any], wanted: frozenset[str]) -> frozenset[str]:
        """Returns the input ports needed to make the wanted output ports; all of them unless a subclass
        overrides it."""
        return frozenset(cls.INPUTS)

    @classmethod
    def missing(cls, params: Mapping[str, Any]) -> Mapping[str, str]:
        """Returns the output ports that there are not with these parameters, with the reason and, after a semicolon,
        the remedy for who reads them."""
        return {}

    @classmethod
    def reads(cls, params: Mapping[str, Any], port: str) -> frozenset[str] | None:
        """Returns the arrays that this node needs of an input's messages, where others may be left out.

        None, unless a subclass knows better: all that there are. See `wants`.
        """
        return None

    @classmethod
    def arrays_hz(cls, params: Mapping[str, Any], port: str) -> float | None:
        """Returns the rate in stamps [Hz] at which this node reads the arrays of an input, by
        `evis.runtime.pacing.RateLimit`.

        port: the topic, where it takes any. None, unless a subclass overrides it: it reads all. The arrays of the other
        messages, where they are on a device, come as they lie there or, from another process, as arrays of no
        environment.
        """
        return None

    @classmethod
    def on_gpu(cls, params: Mapping[str, Any]) -> bool:
        """Tells whether the work is done on the GPU that the parameter `device` names, best in one process with other
        nodes there."""
        return str(params.get("device") or "").startswith("cuda")

    @classmethod
    def imports(cls, params: Mapping[str, Any]) -> Mapping[str, str]:
        """Returns heavy packages that need not be imported, with the reason: {"mujoco": "scene has no dynamics"}."""
        return {}

    @classmethod
    def without_effect(cls, params: Mapping[str, Any]) -> Mapping[str, str]:
        """Returns the parameters that have no effect beside these others, with the reason; who gives one is told so."""
        return {}

    @classmethod
    def random(cls, params: Mapping[str, Any]) -> tuple[str, ...]:
        """Describes in words what the parameter `seed` decides beside these others; empty: every seed gives the
        same."""
        return ()

    @classmethod
    def moved_from_outside(cls, params: Mapping[str, Any]) -> bool:
        """Tells whether there is something for a program outside the graph to control, by a port with `outside`."""
        return True

    @classmethod
    def foreseen(cls, params: Mapping[str, Any]) -> tuple[str, ...]:
        """Returns the warnings that a run with these parameters gives as soon as it is set up, for --explain."""
        return ()

    @classmethod
    def foreseen_among(cls, params: Mapping[str, Any], topics: Collection[str]) -> tuple[str, ...]:
        """Returns those that it gives for what topics the graph publishes."""
        return ()

    @classmethod
    def alike(cls, params: Mapping[str, Any]) -> Any:
        """Returns a key of the warnings in `foreseen` and `warn_alike`: of the nodes with the same key, one gives them.

        None, unless a subclass overrides it: each node gives its own.
        """
        return None

    @classmethod
    def sensor(cls, params: Mapping[str, Any]) -> Mapping[str, Any]:
        """Returns parameters for the readers of a camera's CameraInfo, where this node is that camera's sensor."""
        return {}

    @classmethod
    def pointless(cls, params: Mapping[str, Any]) -> str:
        """Returns why a node with these parameters would have nothing to do, so that it is left out; "" where
        it has."""
        return ""

    @classmethod
    def divides(cls, params: Mapping[str, Any]) -> int:
        """Returns how many updates there are to each message published; of a source, how many steps to a delayed input.

        Raises ValueError for parameters that do not go together.
        """
        return 1

    @classmethod
    def looks_back(cls, params: Mapping[str, Any]) -> int:
        """Returns how many stamps before the last one the next outputs depend on, besides what `state` gives."""
        return 0

    @classmethod
    def check_seed(cls, params: Mapping[str, Any], wanted: frozenset[str], env: int, seed: int) -> None:
        """Raises ValueError, in one line, where an environment cannot begin anew with a seed while the graph runs.

        wanted: the output ports that are made. A subclass that overrides it is asked before anything is reset.
        """

    @classmethod
    def overrides(cls, name: str) -> bool:
        """Tells whether a node says one of these for itself, in its class or in the declaration that it derives from.

        name: of a class method, as "random".
        """
        return getattr(cls, name).__func__ is not getattr(Declaration, name).__func__
