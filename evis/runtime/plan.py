"""Holds the resolved graph, which the planner makes of a launch file, and executor and supervisor run."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from evis.config.secret import Redactor

UNKNOWN = "nobody has found out whether somebody waits for it"
"""Why a plan that no planner has made makes keyframes one by one, and publishes what comes of each at once."""
COMPOSED = "graph"
"""Name of the one process of a composed graph."""


@dataclass
class Edge:
    """Describes one consumer of a topic.

    kind: `lockstep` (declared, never loses), `delayed` (closes a loop) or `tap` (lossy). arrays_hz: messages a second
    in stamps that it reads the arrays of, as its class says; None = all.
    """

    node: str
    port: str
    kind: str = "lockstep"
    arrays_hz: float | None = None


@dataclass
class TopicPlan:
    """Describes one topic of the graph with its publisher and consumers."""

    name: str
    type: str
    node: str
    port: str
    edges: list[Edge] = field(default_factory=list)
    latched: bool = False
    arrays: list[str] | None = None
    """Arrays that the declared consumers need of its messages, as their classes say; None = all."""


@dataclass
class NodePlan:
    """Describes one node: its class by dotted name (`nodes.physics.node:PhysicsNode`), parameters, and wiring.

    inputs: port -> topics (one, but for nodes that take whatever they are told); outputs: port -> topic, without the
    ports that nobody reads. dormant: not started until a viewer asks for one of its topics; its inputs are taps.
    """

    name: str
    target: str
    params: dict[str, Any]
    process: str
    inputs: dict[str, list[str]] = field(default_factory=dict)
    outputs: dict[str, str] = field(default_factory=dict)
    respawn: bool = False
    dormant: bool = False
    keep: list[str] = field(default_factory=list)
    """Output ports that are made even when nobody reads them: what the graph was started for."""
    part: bool = False
    """Has a share of the environments; its topics are for the nodes of that share and for who joins them."""
    joins: bool = False
    """Publishes what others have made, each of a share of the environments."""
    told_by: str = ""
    """The node that says by `Node.warn_alike` what this one would say too; "" = it says it itself."""
    tells_for: list[str] = field(default_factory=list)
    """Nodes for which this one says it."""
    outside: dict[str, str] = field(default_factory=dict)
    """Ports -> topics that a program outside the graph may give, as no node of it does."""
    refuses: bool = False
    """Whether its class may refuse seeds of environments (`Declaration.check_seed`)."""


@dataclass
class LeftOut:
    """Describes one thing that the planner left out of the graph, and why."""

    what: str
    why: str


@dataclass
class Plan:
    """Describes a whole graph. `mode`: lockstep, realtime or live. `duration_s` None = until the sources end."""

    name: str
    run_id: str
    directory: str
    """Private directory of the run: sockets, logs, plan.json; "" where the graph is one process that nobody else can
    reach."""
    mode: str = "lockstep"
    seed: int = 0
    duration_s: float | None = None
    window: int = 2
    waits: str = UNKNOWN
    """Why somebody waits for what comes of each keyframe; "" where nobody does, and it may come with the next one."""
    single: str = UNKNOWN
    """Why every keyframe is made by itself; "" where nobody waits for one, and nodes may make several at once."""
    recorded: bool = False
    """Whether a node takes all that it is told to the host, as a recorder does."""
    nodes: dict[str, NodePlan] = field(default_factory=dict)
    topics: dict[str, TopicPlan] = field(default_factory=dict)
    left_out: list[LeftOut] = field(default_factory=list)
    args: dict[str, Any] = field(default_factory=dict)
    brought: dict[str, str] = field(default_factory=dict)
    """Arguments that nobody gave and that another one brought: name -> `preset:=dvs128`."""

    sensors: dict[str, dict[str, Any]] = field(default_factory=dict)
    """What the sensor of each camera is, for its CameraInfo, by the camera's topics without their last part."""

    launch_text: str = ""
    """The launch file with every argument filled in, as YAML; goes into the bag."""

    random: dict[str, list[str]] = field(default_factory=dict)
    """Of each node that has a seed, what it decides, in words; none: every seed gives the same."""
    warnings: dict[str, list[str]] = field(default_factory=dict)
    """What nodes will warn of as soon as they are set up."""
    chosen: dict[str, Any] = field(default_factory=dict)
    """Arguments that were chosen for the user (interpolator:=auto), and `why`; empty when there are none."""

    imports: list[str] = field(default_factory=list)
    """Files outside evis that were imported for the nodes, before anything runs."""
    unknown: list[dict[str, Any]] = field(default_factory=list)
    """Nodes whose code was not loaded (`--no-import`): what the launch file says of them."""
    secrets: list[str] = field(default_factory=list)
    """Values of secret parameters and arguments; what others may read is made of `redacted`."""
    remote: str = ""
    """Address of the host that the graph runs on, where its topics are followed from another; "" on its own."""

    @property
    def closed(self) -> bool:
        """Tells whether nothing outside its one process can read the graph's topics: there is no socket then."""
        return not self.directory

    def redacted(self) -> Plan:
        """Returns the plan without its secrets."""
        plan: Plan = Redactor(self.secrets).value(self)
        return dataclasses.replace(plan, directory=self.directory, secrets=[])

    def open_topics(self) -> list[str]:
        """Lists the topics for all readers: without those between the shares of environments."""
        inner = {topic for node in self.nodes.values() if node.part for topic in node.outputs.values()}
        return [name for name in self.topics if name not in inner]

    def processes(self) -> dict[str, list[NodePlan]]:
        """Maps each process to its nodes in data-flow order, dormant ones left out."""
        result: dict[str, list[NodePlan]] = {}
        for node in self.nodes.values():
            if not node.dormant:
                result.setdefault(node.process, []).append(node)
        return result

    def downstream(self, node: str) -> list[NodePlan]:
        """Lists the nodes that work on what a node publishes, and on what comes of that."""
        reached, todo = dict.fromkeys([node]), [node]
        while todo:
            source = todo.pop()
            found = [e.node for topic in self.topics.values() if topic.node == source for e in topic.edges]
            todo += [name for name in dict.fromkeys(found) if name not in reached]
            reached |= dict.fromkeys(found)
        return [self.nodes[name] for name in reached if name != node and name in self.nodes]

    def sensor_beside(self, node: str, port: str) -> dict[str, Any]:
        """Describes the sensor that publishes beside an output of a node; {} where there is none."""
        topic = self.nodes[node].outputs.get(port, "") if node in self.nodes else ""
        return self.sensors.get(topic.rpartition("/")[0], {})

    def save(self, path: Path) -> None:
        """Writes the plan as JSON, complete before it appears, for those who look for running graphs at that moment."""
        part = path.with_suffix(".part")
        part.write_text(self.as_json())
        part.replace(path)

    @staticmethod
    def load(path: Path) -> Plan:
        """Reads a plan from the file that `save` wrote."""
        return Plan.of_json(path.read_text())

    def as_json(self) -> str:
        """Writes the plan as JSON."""
        return json.dumps(dataclasses.asdict(self), indent=1)

    @staticmethod
    def of_json(text: str) -> Plan:
        """Reads a plan from what `as_json` wrote."""
        raw = json.loads(text)
        nodes = {k: NodePlan(**v) for k, v in raw.pop("nodes").items()}
        topics = {k: TopicPlan(**{**v, "edges": [Edge(**e) for e in v["edges"]]}) for k, v in raw.pop("topics").items()}
        left_out = [LeftOut(**v) for v in raw.pop("left_out")]
        return Plan(nodes=nodes, topics=topics, left_out=left_out, **raw)
