"""Makes the plan of a graph from a launch file and its arguments, checked before anything starts."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from evis.config.document import LaunchError
from evis.config.params import ParamError
from evis.config.secret import Redactor
from evis.launch import catalog
from evis.launch.arguments import ArgumentError
from evis.launch.catalog import comes_with_evis, files_of
from evis.launch.expand import Expanded, expand
from evis.launch.files import LaunchFile, load
from evis.launch.graph.batching import who_waits
from evis.launch.graph.checks import check_files
from evis.launch.graph.demand import Demand, Pruner, is_open
from evis.launch.graph.edges import connect, in_data_flow_order
from evis.launch.graph.left_out import colourless, left_out, unmade
from evis.launch.graph.pace import check_pace
from evis.launch.graph.sharing import over_devices
from evis.launch.graph.wiring import WiredNode, publishers, secret_values, wire
from evis.launch.resolved_file import as_written, resolved_file
from evis.launch.target import read_target, values_of_scene, with_scene_arguments
from evis.launch.unused_arguments import check_effect, check_options
from evis.runtime.node import with_others
from evis.runtime.plan import COMPOSED, NodePlan, Plan
from msgs.topics import SYSTEM_TOPICS

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
    must_have_effect: Collection[str] | None = None,
    edit: Callable[[Expanded], None] | None = None,
) -> Plan:
    """Plans a launch file that has been read; see `plan_file`.

    must_have_effect: those of the given arguments that are refused where they change nothing; all if None. edit: takes
    the file's nodes before they are wired, to add others to them.
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
            check_effect(launch, list(given) if must_have_effect is None else must_have_effect, expanded, plan)
    except LaunchError as error:
        raise type(error)(hide.text(str(error))) from None
    except ParamError as error:  # of a node's class, about parameters that do not go together
        raise ArgumentError(hide.text(str(error))) from None
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
    connect(plan, chosen)
    plan.nodes = in_data_flow_order(plan)
    check_pace(plan, {node.name: node for node in chosen})
    plan.recorded = any(i.topic == "*" and not i.on_device for node in chosen for i in node.cls.INPUTS.values())
    plan.waits, plan.single = who_waits(plan, chosen, options.stepped)
    if not plan.single:
        plan.window = WINDOW_AT_ONCE if together else WINDOW_ON_CPU
    plan.left_out = left_out(nodes, chosen, demand, expanded.absent) + unmade(plan, chosen, demand) + colourless(plan)
    plan.random = {
        node.among_all(node.name): list(node.cls.random(node.params))
        for node in chosen
        if _draws(node) and not plan.nodes[node.name].dormant
    }
    awake = [node for node in chosen if not plan.nodes[node.name].dormant]
    _share_words(plan, awake)
    if options.explain:
        plan.warnings = {n.among_all(n.name): said for n in awake if (said := _foreseen(plan, n))}
    plan.imports = list(dict.fromkeys(file for node in nodes for file in files_of(node.target)))
    plan.unknown = [as_written(spec) for spec in unknown]
    plan.secrets = list(
        dict.fromkeys([*expanded.secrets, *_idle_secrets(expanded), *(s for node in written for s in node.secrets)])
    )
    # A sensor that nobody reads now is told of too: it is what the frames are made for.
    plan.sensors = {_folder(node): dict(told) for node in [*written, *nodes] if (told := node.cls.sensor(node.params))}
    plan.launch_text = resolved_file(expanded, written, Redactor(plan.secrets))
    return plan


def _share_words(plan: Plan, awake: list[WiredNode]) -> None:
    """Chooses one of the nodes that would give the same warnings to give them for all."""
    first: dict[Any, NodePlan] = {}
    for node in awake:
        if (known := node.cls.alike(node.params)) is not None:
            planned = plan.nodes[node.name]
            speaker = first.setdefault((node.target, repr(known)), planned)
            if speaker is not planned:
                planned.told_by = speaker.name
                speaker.tells_for.append(planned.name)


def _foreseen(plan: Plan, node: WiredNode) -> list[str]:
    """Lists what a node is going to warn of."""
    planned = plan.nodes[node.name]
    own = [] if planned.told_by else [with_others(line, planned.tells_for) for line in node.cls.foreseen(node.params)]
    # What a node publishes that is unknown is so too.
    return own if plan.unknown else [*own, *node.cls.foreseen_among(node.params, plan.topics.keys())]


def _draws(node: WiredNode) -> bool:
    """Tells whether a node draws by its seed, and does not only load with it the world that another node moves."""
    return "seed" in node.cls.PARAMS and node.cls.overrides("random")


def _with_work(expanded: Expanded, nodes: list[WiredNode]) -> list[WiredNode]:
    """Selects the nodes that have something to do; the others become absent ones."""
    reasons = {node.name: why for node in nodes if (why := node.cls.pointless(node.params))}
    expanded.absent.update(reasons)
    expanded.nodes[:] = [spec for spec in expanded.nodes if spec.name not in reasons]
    return [node for node in nodes if node.name not in reasons]


def _folder(node: WiredNode) -> str:
    """Gives what the topics of a camera's node begin with: /cam0."""
    return next(iter(node.outputs.values())).rpartition("/")[0]


def _choose(nodes: list[WiredNode], demand: Demand) -> list[WiredNode]:
    """Selects needed nodes, viewers, and nodes that can be started later from what will be there."""
    needed = [n for n in nodes if n.name in demand.inputs or n.spec.tap]
    there = {t for n in needed for p, t in n.outputs.items() if _is_there(n, p, demand)} | set(SYSTEM_TOPICS)
    late: list[WiredNode] = []
    rest = [n for n in nodes if n.late and n.open and n not in needed]
    while more := [n for n in rest if n not in late and {n.inputs[p] for p in n.inputs if p in _all_needs(n)} <= there]:
        late += more
        there |= {t for n in more for t in n.outputs.values()}
    return [n for n in nodes if n in needed or n in late]


def _all_needs(node: WiredNode) -> frozenset[str]:
    return node.needs(node.outputs)


def _on_one_gpu(nodes: Collection[WiredNode]) -> frozenset[str]:
    """Names the nodes that come with EVIS and compute on a GPU: in one process arrays stay on it from node to node.

    None where there are several GPUs.
    """
    ours = [node for node in nodes if comes_with_evis(node.spec.type) and node.cls.on_gpu(node.params)]
    on_gpu = {node.name: node.params["device"] for node in ours}
    one = len(set(on_gpu.values())) == 1 and not any(node.group for node in nodes)
    return frozenset(on_gpu) if one else frozenset()


def _node_plan(node: WiredNode, demand: Demand, grouping: str, together: Collection[str]) -> NodePlan:
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
        refuses=node.cls.overrides("check_seed"),
        outside={p: node.inputs[p] for p, port in node.cls.INPUTS.items() if port.outside and p not in inputs},
    )


def _is_there(node: WiredNode, port: str, demand: Demand) -> bool:
    """Tells whether a running node offers an output. One that nobody reads stays open for viewers, if the inputs that
    are connected anyway suffice."""
    connected = demand.inputs.get(node.name, {})
    needed = (p for p in node.needs([port]) if p in node.inputs and node.cls.INPUTS[p].needed)
    return is_open(node, port, demand) and all(connected.get(p) for p in needed)


def _idle_secrets(expanded: Expanded) -> Iterator[str]:
    """Finds secrets that were meant for nodes which are not there, of the types that come with evis."""
    for kind, params in expanded.idle:
        if kind in catalog.types() and any(isinstance(value, str) for value in params.values()):
            yield from secret_values(catalog.load(kind, expanded.file)[1], params)
