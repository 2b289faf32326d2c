"""Makes the plan of a graph from a launch file and its arguments, checked before anything starts."""

from __future__ import annotations

import dataclasses
import fnmatch
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from evis.config.document import LaunchError
from evis.config.secret import Redactor
from evis.launch import catalog
from evis.launch.catalog import comes_with_evis, files_of
from evis.launch.expand import Expanded, NodeSpec, expand
from evis.launch.files import LaunchFile, load
from evis.launch.graph.checks import check_files
from evis.launch.graph.demand import Demand, Pruner, globs_of, is_open, left_out
from evis.launch.graph.order import data_flow_order
from evis.launch.graph.pace import check_pace
from evis.launch.graph.sharing import over_devices
from evis.launch.graph.single import who_waits
from evis.launch.graph.wiring import Wired, publishers, secret_values, wire
from evis.launch.target import read_target, values_of_scene, with_scene_arguments
from evis.launch.unused_arguments import check_effect, check_options
from evis.runtime.plan import COMPOSED, Edge, LeftOut, NodePlan, Plan, TopicPlan
from msgs.camera import Image, Keyframe
from msgs.fields import by_environment
from msgs.topics import SYSTEM_TOPICS, find_topic

WINDOW_AT_ONCE, WINDOW_ON_CPU = 34, 10
"""Messages of a topic that may be under way where several keyframes are made at once, on a GPU and on a CPU: all of
them, at most as many as nodes/renderer/at_once.py says, and two more."""


@dataclass(frozen=True)
class Options:
    """Holds what the command line says besides arguments. grouping: `default`, `compose` or `split`.

    explain: the plan is to be read, so nodes say what they will warn of.
    stepped: who holds the graph steps its source.
    no_import: only nodes that come with evis are loaded; the others are shown as unknown, and the plan cannot be run.
    """

    duration_s: float | None = None
    record: str | None = None
    record_topics: tuple[str, ...] = ()
    record_sync: bool = False
    view: bool = True
    grouping: str = "default"
    explain: bool = False
    stepped: bool = False
    no_import: bool = False

    def names(self) -> dict[str, Any]:
        """Returns the values behind arguments.OPTIONS."""
        return {
            "duration": self.duration_s,
            "record": self.record,
            "record_topics": list(self.record_topics),
            "record_sync": self.record_sync,
            "view": self.view,
        }


def plan_file(path: Path, given: Mapping[str, Any], options: Options) -> Plan:
    """Plans a launch file. Raises LaunchError (file:line, what is wrong, the nearest valid name)."""
    return plan_launch(load(path), given, options)


def plan_target(name: str, given: Mapping[str, Any], options: Options) -> Plan:
    """Plans what may stand after `evis launch`, a launch file or a scene. Raises LaunchError, UnknownLaunch."""
    target = read_target(name, given)
    plan = plan_launch(target.launch, target.given, options)
    plan.name = target.name
    return plan


def plan_launch(
    launch: LaunchFile,
    given: Mapping[str, Any],
    options: Options,
    held: Collection[str] | None = None,
    edit: Callable[[Expanded], None] | None = None,
) -> Plan:
    """Plans a launch file that has been read; see `plan_file`. held: the given arguments that must have an effect, all
    if None. edit: takes the file's nodes before they are wired, to add others to them.
    """
    check_options(launch, options.names())
    given = with_scene_arguments(launch, given)
    hide = Redactor(str(given[name]) for name, a in launch.arguments.items() if a.param.secret and name in given)
    try:
        expanded = expand(launch, given, options.names())
        if edit is not None:
            edit(expanded)
        plan = plan_nodes(expanded, launch.path.resolve().parent, options)
        for secret in plan.secrets:
            hide.add(secret)
        if not plan.unknown:  # an unknown node may read what nobody else does
            check_effect(launch, list(given) if held is None else held, expanded, plan)
    except LaunchError as error:
        raise type(error)(hide.text(str(error))) from None
    plan.args |= values_of_scene(launch, plan.args)
    plan.name = launch.path.stem
    return plan


def plan_nodes(expanded: Expanded, folder: Path, options: Options) -> Plan:
    """Plans nodes that are described already; see `plan_file`. folder: where their own modules may lie."""
    if not expanded.nodes:
        raise LaunchError(f"{expanded.file}: the graph has no node")
    unknown = [spec for spec in expanded.nodes if options.no_import and not comes_with_evis(spec.type)]
    written = _with_work(expanded, [wire(spec, folder) for spec in expanded.nodes if spec not in unknown])
    nodes = over_devices(written)
    published = publishers(nodes)
    demand = Pruner(nodes, published, partial=bool(unknown)).run()
    for node in nodes:
        if node.name in demand.inputs:
            check_files(node)
    plan = Plan(
        name=expanded.file,
        run_id="",
        directory="",
        mode=expanded.mode,
        seed=int(expanded.values.get("seed") or 0),
        duration_s=options.duration_s,
        args=dict(expanded.values),
        brought=dict(expanded.brought),
    )
    chosen = _choose(nodes, demand)
    together = _on_one_gpu(chosen)
    if not unknown and not any(node.name in demand.inputs for node in nodes):
        raise LaunchError(f"{expanded.file}: nobody reads anything: give a node `keep: [PORT]`, or record")
    for node in chosen:
        plan.nodes[node.name] = _node_plan(node, demand, options.grouping, together)
    _connect(plan, chosen)
    plan.nodes = _in_order(plan)
    check_pace(plan, {node.name: node for node in chosen})
    plan.waits, plan.single = who_waits(plan, chosen, options.stepped)
    if not plan.single:
        plan.window = WINDOW_AT_ONCE if together else WINDOW_ON_CPU
    plan.left_out = left_out(nodes, chosen, demand, expanded.absent) + _unmade(plan, chosen, demand) + _colourless(plan)
    plan.random = {
        node.among_all(node.name): list(node.cls.random(node.params))
        for node in chosen
        if _draws(node) and not plan.nodes[node.name].dormant
    }
    if options.explain:
        awake = [node for node in chosen if not plan.nodes[node.name].dormant]
        plan.warnings = {n.among_all(n.name): list(said) for n in awake if (said := n.cls.foreseen(n.params))}
    plan.imports = list(dict.fromkeys(file for node in nodes for file in files_of(node.target)))
    plan.unknown = [_as_written(spec) for spec in unknown]
    plan.secrets = list(
        dict.fromkeys([*expanded.secrets, *_idle_secrets(expanded), *(s for node in written for s in node.secrets)])
    )
    # A sensor that nobody reads now is told of too: it is what the frames are made for.
    plan.sensors = {_folder(node): dict(told) for node in [*written, *nodes] if (told := node.cls.sensor(node.params))}
    plan.launch_text = _resolved(expanded, written, Redactor(plan.secrets))
    return plan


def _draws(node: Wired) -> bool:
    """Whether the seed is the node's own, and not handed on for it to see the world that another one tells of."""
    return "seed" in node.cls.PARAMS and "random" in vars(node.cls)


def _with_work(expanded: Expanded, nodes: list[Wired]) -> list[Wired]:
    """The nodes that have something to do; the others become absent ones."""
    reasons = {node.name: why for node in nodes if (why := node.cls.pointless(node.params))}
    expanded.absent.update(reasons)
    expanded.nodes[:] = [spec for spec in expanded.nodes if spec.name not in reasons]
    return [node for node in nodes if node.name not in reasons]


def _folder(node: Wired) -> str:
    """Of the topics of a camera's node: /cam0."""
    return next(iter(node.outputs.values())).rpartition("/")[0]


def attach(plan: Plan, spec: NodeSpec, folder: Path) -> None:
    """Adds one node to the plan of a running graph: its inputs are taps, its process is its own.

    Raises LaunchError when the graph lacks a topic that it reads, or has one that it would publish.
    """
    node = wire(spec, folder)
    for topic in node.outputs.values():
        if topic in plan.topics:
            raise LaunchError(
                f"{spec.type} would publish {topic}, which {plan.topics[topic].node} of the running graph publishes; "
                "a topic has one publisher: start the graph without that node, or give this one's topic another name "
                "by `remap` in a launch file"
            )
    available = {name: (node, "") for name in plan.open_topics() if name not in _unmade_images(plan, node)}
    demand = Pruner([node], available).attached(node)
    planned = NodePlan(node.name, node.target, node.params, spec.process, demand.inputs[node.name])
    planned.outputs = dict(node.outputs)
    plan.nodes[node.name] = planned
    plan.secrets += node.secrets
    for port, topic in planned.outputs.items():
        plan.topics[topic] = TopicPlan(topic, find_topic(topic).type.__name__, node.name, port)
    for port, topics in planned.inputs.items():
        for topic in topics:
            if topic not in SYSTEM_TOPICS:
                plan.topics[topic].edges.append(Edge(node.name, port, "tap"))


def _unmade_images(plan: Plan, node: Wired) -> set[str]:
    """Images that a running graph could make and does not: for who is not told to take them there are none, so that a
    recorder makes its preview.
    """
    if node.any_port is None:
        return set()
    dormant = {topic for other in plan.nodes.values() if other.dormant for topic in other.outputs.values()}
    images = {topic for topic in dormant & plan.topics.keys() if plan.topics[topic].type == Image.__name__}
    return images - {topic for glob in globs_of(node) for topic in fnmatch.filter(images, glob)}


def _choose(nodes: list[Wired], demand: Demand) -> list[Wired]:
    """Needed nodes, viewers, and nodes that can be started later from what will be there."""
    needed = [n for n in nodes if n.name in demand.inputs or n.spec.tap]
    there = {t for n in needed for p, t in n.outputs.items() if _is_there(n, p, demand)} | set(SYSTEM_TOPICS)
    late: list[Wired] = []
    rest = [n for n in nodes if n.late and n.open and n not in needed]
    while more := [n for n in rest if n not in late and {n.inputs[p] for p in n.inputs if p in _all_needs(n)} <= there]:
        late += more
        there |= {t for n in more for t in n.outputs.values()}
    return [n for n in nodes if n in needed or n in late]


def _all_needs(node: Wired) -> frozenset[str]:
    return node.needs(node.outputs)


def _on_one_gpu(nodes: Collection[Wired]) -> frozenset[str]:
    """Names the nodes that come with EVIS and compute on a GPU: in one process arrays stay on it from node to node.

    None where there are several GPUs.
    """
    ours = [node for node in nodes if comes_with_evis(node.spec.type) and node.cls.on_gpu(node.params)]
    on_gpu = {node.name: node.params["device"] for node in ours}
    one = len(set(on_gpu.values())) == 1 and not any(node.group for node in nodes)
    return frozenset(on_gpu) if one else frozenset()


def _node_plan(node: Wired, demand: Demand, grouping: str, together: Collection[str]) -> NodePlan:
    dormant = node.name not in demand.inputs and not node.spec.tap
    process = node.spec.process
    if grouping == "split" or dormant:
        process = node.name
    elif grouping == "compose" and not node.spec.tap:
        process = node.group or COMPOSED
    elif node.name in together and not node.spec.tap:
        process = COMPOSED
    if dormant:
        inputs = {p: [node.inputs[p]] for p in node.inputs if p in _all_needs(node)}
    elif node.name in demand.inputs:
        inputs = {port: list(topics) for port, topics in demand.inputs[node.name].items() if topics}
    else:
        inputs = {}
    outputs = {
        port: topic
        for port, topic in node.outputs.items()
        if topic not in SYSTEM_TOPICS and (dormant or _is_there(node, port, demand))
    }
    return NodePlan(
        name=node.name,
        target=node.target,
        params=node.params,
        process=process.replace("/", "."),
        inputs=inputs,
        outputs=outputs,
        respawn=node.spec.respawn,
        dormant=dormant,
        keep=list(node.spec.keep),
        part=node.part,
        joins=node.joins,
        outside={p: node.inputs[p] for p, port in node.cls.INPUTS.items() if port.outside and p not in inputs},
    )


def _is_there(node: Wired, port: str, demand: Demand) -> bool:
    """Tells whether a running node offers an output. One that nobody reads stays open for viewers, if the inputs that
    are connected anyway suffice."""
    connected = demand.inputs.get(node.name, {})
    needed = (p for p in node.needs([port]) if p in node.inputs and node.cls.INPUTS[p].needed)
    return is_open(node, port, demand) and all(connected.get(p) for p in needed)


def _connect(plan: Plan, chosen: list[Wired]) -> None:
    for planned in plan.nodes.values():
        for port, topic in planned.outputs.items():
            row = find_topic(topic)
            plan.topics[topic] = TopicPlan(topic, row.type.__name__, planned.name, port, latched=row.latched)
    for node in chosen:
        planned = plan.nodes[node.name]
        if node.spec.tap:
            planned.inputs |= {p: [t] for p, t in node.inputs.items() if t in plan.topics or t in SYSTEM_TOPICS}
        for port, topics in planned.inputs.items():
            for topic in topics:
                if topic not in SYSTEM_TOPICS:
                    kind, hz = _kind(node, port, topic, planned), _arrays_hz(node, port, topic, planned)
                    plan.topics[topic].edges.append(Edge(node.name, port, kind, hz))
    wired = {node.name: node for node in chosen}
    for name in plan.topics:
        plan.topics[name].arrays = _read_arrays(plan, name, wired)


def _arrays_hz(node: Wired, port: str, topic: str, planned: NodePlan) -> float | None:
    """How often a node reads arrays of a topic, of one whose messages can be sent with none."""
    if not by_environment(find_topic(topic).type):
        return None
    return node.cls.arrays_hz(planned.params, node.port_of(port, topic))


def _read_arrays(plan: Plan, topic: str, wired: Mapping[str, Wired]) -> list[str] | None:
    """Arrays that the declared consumers of a topic need; None where one takes all, or there is none."""
    declared = [edge for edge in plan.topics[topic].edges if edge.kind != "tap"]
    ports = [wired[edge.node].port_of(edge.port, topic) for edge in declared]
    read = [wired[edge.node].cls.reads(plan.nodes[edge.node].params, port) for edge, port in zip(declared, ports)]
    known = [arrays for arrays in read if arrays is not None]
    return sorted(frozenset().union(*known)) if known and len(known) == len(read) else None


def _kind(node: Wired, port: str, topic: str, planned: NodePlan) -> str:
    if node.spec.tap or planned.dormant or not find_topic(topic).lockstep:
        return "tap"
    return "lockstep" if node.cls.INPUTS[port].needed else "delayed"


def _in_order(plan: Plan) -> dict[str, NodePlan]:
    edges: dict[str, list[tuple[str, str]]] = {}
    for topic in plan.topics.values():
        edges.setdefault(topic.node, []).extend((e.node, topic.name) for e in topic.edges if e.kind == "lockstep")
    return {name: plan.nodes[name] for name in data_flow_order(list(plan.nodes), edges)}


def _unmade(plan: Plan, chosen: list[Wired], demand: Demand) -> list[LeftOut]:
    """Outputs that cannot be opened later, because their inputs are not connected."""
    return [
        LeftOut(f"{node.name} -> {topic}", "its inputs are not connected")
        for node in chosen
        if not node.part
        for port, topic in node.outputs.items()
        if topic not in SYSTEM_TOPICS and port not in plan.nodes[node.name].outputs and is_open(node, port, demand)
    ]


def _colourless(plan: Plan) -> list[LeftOut]:
    """Colour of the keyframes, where nobody reads it."""
    made = [topic for topic in plan.topics.values() if not plan.nodes[topic.node].dormant]
    keyframes = [topic for topic in made if topic.type == Keyframe.__name__]
    grey = [topic.name for topic in keyframes if topic.arrays is not None and "radiance" not in topic.arrays]
    if not grey:
        return []
    which = "keyframes" if len(grey) == len(keyframes) else f"keyframes of {', '.join(grey)}"
    return [LeftOut(which, "luminance only; nobody reads colour")]


def _as_written(spec: NodeSpec) -> dict[str, Any]:
    """What a launch file says of a node, as far as it says anything."""
    return {key: value for key, value in dataclasses.asdict(spec).items() if value and key != "param_lines"}


def _resolved(expanded: Expanded, nodes: Sequence[Wired], hide: Redactor) -> str:
    """The launch file with every argument filled in and no secret, which `evis launch` can run again."""
    body: dict[str, Any] = {"description": expanded.description or expanded.file, "mode": expanded.mode, "nodes": {}}
    for node in nodes:
        spec = node.spec
        name = spec.name.removeprefix(f"{spec.namespace}/")
        entry: dict[str, Any] = {"type": spec.type, "params": _plain_values(node), "process": spec.process}
        extras = {"remap": spec.remap, "namespace": spec.namespace, "respawn": spec.respawn, "keep": spec.keep}
        flags = {"tap": spec.tap, "on_demand": spec.on_demand}
        body["nodes"][name] = entry | {k: v for k, v in (extras | flags).items() if v}
    return yaml.safe_dump(hide.value(body), sort_keys=False, width=120)


def _plain_values(node: Wired) -> dict[str, Any]:
    """Its parameters but those that are not given. Secret ones are left out, so that the file can be run again."""
    return {k: v for k, v in node.params.items() if v is not None and not node.cls.PARAMS[k].secret}


def _idle_secrets(expanded: Expanded) -> Iterator[str]:
    """Secrets that were meant for nodes which are not there, of the types that come with evis."""
    for kind, params in expanded.idle:
        if kind in catalog.types() and any(isinstance(value, str) for value in params.values()):
            yield from secret_values(catalog.load(kind, expanded.file)[1], params)
