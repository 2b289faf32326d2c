"""Wires nodes with their topics: names from parameters, namespaces and remaps, and who publishes what."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from evis.config.document import LaunchError
from evis.config.expression import text_of
from evis.config.params import ParamError, resolve
from evis.config.suggestions import nearest
from evis.launch import catalog
from evis.launch.arguments import ArgumentError
from evis.launch.expand import NodeSpec
from evis.runtime.declaration import ANY
from evis.runtime.node import Node
from msgs.topics import SYSTEM_TOPICS, Topic, UnknownTopic, find_topic

_PARAMETER = re.compile(r"\{(\w+)\}")


@dataclass
class WiredNode:
    """Holds one node with its class, parameters and topics. inputs, outputs: port -> topic, ports of ANY left out.

    group: its process where all others are composed, for it is on another device than they are. part: it has a share of
    the environments, and its topics are for the one that joins the shares (`joins`), whose topics are those of all.
    open: who comes while the graph runs may have these.
    """

    spec: NodeSpec
    target: str
    cls: type[Node]
    params: dict[str, Any]
    inputs: dict[str, str] = field(default_factory=dict)
    outputs: dict[str, str] = field(default_factory=dict)
    group: str = ""
    part: bool = False
    joins: bool = False
    open: bool = True

    @property
    def name(self) -> str:
        """Returns the name of the node."""
        return self.spec.name

    @property
    def late(self) -> bool:
        """Tells whether it is started only when a viewer asks for it."""
        return self.joins or self.spec.on_demand

    def late_output(self, port: str) -> bool:
        """Tells whether who comes while the graph runs may have an output that nobody reads from the start."""
        declared = self.cls.OUTPUTS.get(port)
        return self.open if declared is None or self.joins else declared.late

    def port_of(self, port: str, topic: str) -> str:
        """Returns the name by which the node knows what comes on a port: the topic's where the port takes any."""
        return topic if self.cls.INPUTS[port].topic == ANY else port

    def among_all(self, name: str) -> str:
        """Returns the name of this node, or of a topic of it, without the share that it has."""
        return name.replace(f"{self.group}/", "", 1) if self.part else name

    @property
    def secrets(self) -> list[str]:
        """Returns the values of its secret parameters."""
        return secret_values(self.cls, self.params)

    def needs(self, wanted: Iterable[str]) -> frozenset[str]:
        """Returns the input ports that the wanted outputs need. Raises ArgumentError for parameters that do not go
        together.
        """
        try:
            return self.cls.needs(self.params, frozenset(wanted))
        except ValueError as error:
            raise ArgumentError(f"{self.spec.where}: '{self.name}': {error}") from None

    @property
    def divides(self) -> int:
        """Returns how many updates there are to each message, as the node's class says.

        Raises ArgumentError as `needs` does.
        """
        try:
            return self.cls.divides(self.params)
        except ValueError as error:
            raise ArgumentError(f"{self.spec.where}: '{self.name}': {error}") from None

    @property
    def any_port(self) -> str | None:
        """Returns the input port that takes whatever it is told, if there is one."""
        return next((p for p, port in self.cls.INPUTS.items() if port.topic == ANY), None)


def wire(spec: NodeSpec, folder: Path) -> WiredNode:
    """Loads a node's class, checks its parameters and names its topics. Raises LaunchError with file:line."""
    target, cls = catalog.load(spec.type, spec.where, folder)
    # null stands for "not given": the parameter keeps its default.
    given = {key: _plain(cls, key, value) for key, value in spec.params.items() if value is not None}
    try:
        params = resolve(spec.name, cls.PARAMS, given)
    except ParamError as error:
        culprit = next((k for k in spec.params if f" {k} is " in str(error) or f"'{k}'" in str(error)), "")
        raise LaunchError(f"{spec.param_lines.get(culprit, spec.where)}: {error}") from None
    node = WiredNode(spec, target, cls, params)
    for port, source in cls.INPUTS.items():
        if source.topic != ANY:
            node.inputs[port] = _topic(node, port, source.topic)
    for port, topic in _outputs(node).items():
        node.outputs[port] = _topic(node, port, topic)
    known = {*node.inputs, *node.outputs, *_before_remap(node)}
    for name in spec.remap:
        if name not in known:
            raise LaunchError(
                f"{spec.where}: '{spec.name}' has nothing called '{name}' to remap; {nearest(name, known)}"
            )
    if spec.keep == [ANY]:
        spec.keep = list(node.outputs)
    for port in spec.keep:
        if port not in node.outputs:
            raise LaunchError(f"{spec.where}: '{spec.name}' has no output '{port}'; {nearest(port, node.outputs)}")
    return node


def secret_values(cls: type[Node], params: Mapping[str, Any]) -> list[str]:
    """Returns the values among `params` of what a node's class declares secret."""
    return [str(params[key]) for key, param in cls.PARAMS.items() if param.secret and params.get(key)]


def _plain(cls: type[Node], key: str, value: Any) -> Any:
    """Writes a map that is given for a text parameter as `a=1,b=2`, without the entries that are null."""
    param = cls.PARAMS.get(key)
    if isinstance(value, dict) and param is not None and param.type is str:
        return ",".join(f"{k}={text_of(v)}" for k, v in value.items() if v is not None and v != "")
    return value


def _outputs(node: WiredNode) -> dict[str, str]:
    """Maps ports to topic patterns. A node whose outputs depend on its parameters (a replayer) says so itself."""
    dynamic = getattr(node.cls, "dynamic_outputs", None)
    if dynamic is None:
        return {port: output.topic for port, output in node.cls.OUTPUTS.items()}
    try:
        return {port: output.topic for port, output in dynamic(node.params).items()}
    except (ValueError, OSError) as error:
        raise LaunchError(f"{node.spec.where}: {error}") from None


def _before_remap(node: WiredNode) -> set[str]:
    """Topics as declared, and below the namespace: either may be named in `remap`."""
    declared = {i.topic for i in node.cls.INPUTS.values() if i.topic != ANY} | set(_outputs(node).values())
    bare = {_named(node, topic) for topic in declared}
    return bare | ({f"/{node.spec.namespace}{topic}" for topic in bare} if node.spec.namespace else set())


def _named(node: WiredNode, pattern: str) -> str:
    def fill(hole: re.Match[str]) -> str:
        if hole[1] not in node.params:
            raise LaunchError(f"{node.spec.where}: topic {pattern} needs the parameter '{hole[1]}' of '{node.name}'")
        return str(node.params[hole[1]])

    return _PARAMETER.sub(fill, pattern)


def _topic(node: WiredNode, port: str, pattern: str) -> str:
    """Names the topic of a port: parameters filled in, remapped by port or by name, below the namespace."""
    spec = node.spec
    declared = _named(node, pattern)
    row = row_of(declared, f"{spec.where}: '{spec.name}'")
    if declared in SYSTEM_TOPICS:
        return declared
    namespaced = f"/{spec.namespace}{declared}" if spec.namespace else declared
    for key in (port, declared, namespaced):
        if key in spec.remap:
            target = spec.remap[key]
            if not target.startswith("/"):
                # As in ROS, a relative name lies below the namespace.
                target = f"/{spec.namespace}/{target}" if spec.namespace else f"/{target}"
            other = row_of(target, f"{spec.where}: remap of '{spec.name}'")
            if other.type is not row.type:
                raise LaunchError(
                    f"{spec.where}: '{spec.name}' has {row.type.__name__} on {port}, but {target} carries "
                    f"{other.type.__name__}"
                )
            return target
    return namespaced


def row_of(topic: str, where: str) -> Topic:
    """Finds the topic table's row. Raises LaunchError for a name that no row matches."""
    try:
        return find_topic(topic)
    except UnknownTopic as error:
        raise LaunchError(f"{where}: {error}") from None


def publishers(nodes: Iterable[WiredNode]) -> dict[str, tuple[WiredNode, str]]:
    """Maps each topic to the node and port that publish it. Raises LaunchError naming both nodes when two publish one
    topic.
    """
    found: dict[str, tuple[WiredNode, str]] = {}
    for node in nodes:
        for port, topic in node.outputs.items():
            if topic in SYSTEM_TOPICS:
                continue
            if topic in found:
                other = found[topic][0]
                raise LaunchError(
                    f"{node.spec.where}: '{node.name}' and '{other.name}' ({other.spec.where}) both publish {topic}; "
                    "remap one of them"
                )
            found[topic] = (node, port)
    return found
