"""Expands a launch file, with its includes, conditions and loops, to a flat list of nodes with final parameters."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from evis.config.document import LaunchError, Table, submap
from evis.config.expression import ExpressionError, Room, UnknownName, substitute, text_of
from evis.config.suggestions import nearest
from evis.launch import node_arguments
from evis.launch.arguments import OPTIONS, brought, resolve
from evis.launch.files import LaunchFile
from evis.launch.rates import pairs, with_camera_rates, with_cameras
from evis.launch.recorded import recorded

NODE_KEYS = (
    "type", "params", "process", "remap", "namespace", "if", "unless", "otherwise", "respawn", "foreach",
    "lookup", "keep", "tap", "on_demand", "spares",
)  # fmt: skip
MODES = ("lockstep", "realtime", "live")
MAX_NODES = 1000
"""Most nodes of a graph, those that are left out by a condition counted too."""
MAX_NAME = 200
"""Longest name of a node or process [bytes]: files are called after it."""


@dataclass
class NodeSpec:
    """Describes one node of a launch file before it is wired.

    keep: output ports that are made even when nobody reads them, `*` for all. tap: reads without making anything
    necessary. on_demand: not for the recorder's default, and started late when only a viewer asks. spares: work that
    these parameters save, with the reason, for the list of what is left out.
    """

    name: str
    type: str
    where: str
    params: dict[str, Any] = field(default_factory=dict)
    param_lines: dict[str, str] = field(default_factory=dict)
    process: str = ""
    remap: dict[str, str] = field(default_factory=dict)
    namespace: str = ""
    respawn: bool = False
    keep: list[str] = field(default_factory=list)
    tap: bool = False
    on_demand: bool = False
    spares: dict[str, str] = field(default_factory=dict)


@dataclass
class Expanded:
    """Holds a launch file whose includes, conditions and `${...}` are resolved. absent: nodes whose condition was
    false, with the reason.

    idle: types of those nodes, with the parameters that they would have got. secrets: values of secret arguments.
    """

    file: str
    description: str
    mode: str
    values: dict[str, Any]
    nodes: list[NodeSpec] = field(default_factory=list)
    absent: dict[str, str] = field(default_factory=dict)
    idle: list[tuple[str, dict[str, Any]]] = field(default_factory=list)
    secrets: list[str] = field(default_factory=list)
    brought: dict[str, str] = field(default_factory=dict)
    """Arguments whose default another argument brought, as `preset:=dvs128`."""


def expand(
    launch: LaunchFile, given: Mapping[str, Any], options: Mapping[str, Any], room: Room | None = None
) -> Expanded:
    """Resolves the includes, conditions and `${...}` of a launch file.

    Args:
        launch: the file, with those that it includes.
        given: its arguments.
        options: the values behind the names in arguments.OPTIONS.
        room: what `${...}` may make yet of the file that includes this one; None = this one is the first.

    Raises LaunchError, ArgumentError.
    """
    room = room or Room()
    table = launch.table
    values = resolve(launch.path.name, launch.arguments, given, room)
    if "recorded" in table:
        found_there = recorded(submap(table, "recorded"), values, given)
        values = resolve(launch.path.name, launch.arguments, found_there, room)
    if not launch.includes:
        # Only where the scene's arguments are known in full.
        values = with_camera_rates(launch.path.name, with_cameras(launch.path.name, values))
    scope = {**options, **values}
    mode = str(_fill(table, "mode", scope, "lockstep"))
    if mode not in MODES:
        raise LaunchError(f"{table.where('mode')}: no mode '{mode}'; {nearest(mode, MODES)}")
    result = Expanded(launch.path.name, launch.description, mode, values)
    result.secrets = [values[name] for name, a in launch.arguments.items() if a.param.secret and values[name]]
    found = brought(launch.arguments, values, given)
    result.brought = {name: f"{other}:={text_of(values[other])}" for name, (other, _) in found.items()}
    for entry, child in launch.includes:
        if not _holds(entry, scope):
            continue
        set_here = {k: _fill(submap(entry, "args"), k, scope, room=room) for k in submap(entry, "args")}
        # Sizes that a preset brings which is set here are the child's to find.
        own = [k for k, a in child.arguments.items() if a.by[0] in set_here and k not in given]
        passed = {k: values[k] for k in child.arguments if k in values and k not in set_here and k not in own}
        part = expand(child, set_here | passed, options, room)
        prefix = _namespace(entry, scope)
        for node in part.nodes:
            node.namespace = _join(prefix, node.namespace)
            node.name = f"{prefix}/{node.name}" if prefix else node.name
            node.process = f"{prefix}/{node.process}" if prefix else node.process
        result.nodes += part.nodes
        result.absent |= part.absent
        result.idle += part.idle
        result.secrets += part.secrets
        result.brought |= {k: v for k, v in part.brought.items() if k in own}
        for name in ("camera_rate", "cameras", *own):
            if name in values and part.values.get(name) is not None:
                result.values[name] = part.values[name]
        if "mode" not in table:
            result.mode = part.mode
    nodes = submap(table, "nodes")
    # What an included file has found (the scene's cameras, a preset's size) counts for the nodes of this one too.
    scope = {**options, **result.values}
    for name in nodes:
        if not isinstance(nodes[name], Table):
            raise LaunchError(f"{nodes.where(name)}: node '{name}' must be a map with at least `type:`")
        _expand_node(result, nodes, name, scope, room)
    _check_names(result.nodes)
    return result


def _expand_node(result: Expanded, nodes: Table, name: str, scope: Mapping[str, Any], room: Room) -> None:
    entry: Table = nodes[name]
    entry.check_keys(NODE_KEYS, f"node '{name}'")
    if len(result.nodes) + len(result.absent) >= MAX_NODES:
        raise LaunchError(f"{nodes.where(name)}: more than {MAX_NODES} nodes up to here")
    loop = list(turns(entry, scope))
    if not loop:
        result.absent[name] = "its `foreach` has nothing to go over"
    for turn, several, inner in loop:
        suffix = "_" + "_".join(text_of(v) for v in turn.values()) if several else ""
        full = _named(nodes, name, name, inner, suffix)
        if not _holds(entry, inner):
            with contextlib.suppress(LaunchError):  # what it would have got may make sense only where it is there
                kind = str(_fill(entry, "type", inner))
                result.idle.append((kind, _params(entry, inner, nodes.where(name), room)))
            result.absent[full] = str(_fill(entry, "otherwise", inner, _condition(entry)))
            continue
        if "type" not in entry:
            included = f"; the included '{full}' is changed by arguments of its file alone, under `args:`"
            hint = included if any(node.name == full for node in result.nodes) else ""
            raise LaunchError(f"{nodes.where(name)}: node '{name}' has no `type:`{hint}")
        params = submap(entry, "params")
        namespace = _namespace(entry, inner)
        prefix = f"{namespace}/" if namespace else ""
        process = _process(entry, full, inner, suffix)
        for what, called in (("node", prefix + full), ("process", prefix + process)):
            _check_name(what, called, nodes.where(name))
        remap, spares = submap(entry, "remap"), submap(entry, "spares")
        result.nodes.append(
            NodeSpec(
                name=prefix + full,
                type=str(_fill(entry, "type", inner)),
                where=nodes.where(name),
                params=_params(entry, inner, nodes.where(name), room),
                param_lines={k: params.where(k) for k in params},
                process=prefix + process,
                remap={str(k): str(target) for k in remap if (target := _fill(remap, k, inner, room=room))},
                namespace=namespace,
                respawn=_flag(entry, "respawn", inner),
                keep=_ports(entry, inner),
                tap=_flag(entry, "tap", inner),
                on_demand=_flag(entry, "on_demand", inner),
                spares={k: str(why) for k in spares if (why := _fill(spares, k, inner, room=room))},
            )
        )


def _params(entry: Table, scope: Mapping[str, Any], where: str, room: Room) -> dict[str, Any]:
    """Fills in the parameters that a node sets, and adds those that are arguments as they are."""
    params = submap(entry, "params")
    # What `lookup` finds may be called as a parameter that means something else.
    others = {*OPTIONS, *submap(entry, "lookup")}
    arguments = {name: value for name, value in scope.items() if name not in others}
    passed = node_arguments.passed_on(entry, arguments, where)
    own = [k for k in params if k != node_arguments.FROM or not node_arguments.takes_arguments(params)]
    return passed | {k: _fill(params, k, scope, room=room) for k in own}


def turns(entry: Table, scope: Mapping[str, Any]) -> Iterator[tuple[dict[str, Any], bool, dict[str, Any]]]:
    """Yields for each turn of a node's `foreach` its variables, whether there are several turns, and all names that
    hold in it, those of `lookup` too. Raises LaunchError.
    """
    loops = submap(entry, "foreach")
    found: list[dict[str, Any]] = [{}]
    for variable in loops:
        items = _words(_fill(loops, variable, scope))
        if len(found) * len(items) > MAX_NODES:
            raise LaunchError(
                f"{loops.where(variable)}: makes {len(found) * len(items)} nodes; the most is {MAX_NODES}"
            )
        found = [{**turn, variable: item} for turn in found for item in items]
    for turn in found:
        inner = {**scope, **turn}
        inner |= _looked_up(entry, inner, [text_of(value) for value in turn.values()])
        yield turn, len(found) > 1, inner


def _looked_up(entry: Table, scope: Mapping[str, Any], items: list[str]) -> dict[str, Any]:
    """Finds the variables of `lookup`: of a `name=value` list, the value whose name is an item of this turn.

    None where it names none of them.
    """
    found: dict[str, Any] = {}
    for variable in (lookup := submap(entry, "lookup")):
        known = pairs(_words(_fill(lookup, variable, scope)))
        value: Any = next((known[item] for item in items if item in known), None)
        with contextlib.suppress(TypeError, ValueError):
            value = float(value)
        found[variable] = value
    return found


def _named(table: Table, key: str, text: Any, scope: Mapping[str, Any], suffix: str) -> str:
    """Fills the holes of a name; one without a hole gets the values of the turn behind it when there are several."""
    try:
        filled = text_of(substitute(text, scope))
    except ExpressionError as error:
        raise _located(error, table, key, scope) from None
    return filled if "${" in str(text) else filled + suffix


def _process(entry: Table, node: str, scope: Mapping[str, Any], suffix: str) -> str:
    return _named(entry, "process", entry["process"], scope, suffix) if "process" in entry else node


def _fill(table: Table, key: str, scope: Mapping[str, Any], default: Any = None, room: Room | None = None) -> Any:
    if key not in table:
        return default
    try:
        return substitute(table[key], scope, room)
    except ExpressionError as error:
        raise _located(error, table, key, scope) from None


def _located(error: ExpressionError, table: Table, key: str, scope: Mapping[str, Any]) -> LaunchError:
    hint = f"; {nearest(error.name, scope)}" if isinstance(error, UnknownName) else ""
    return LaunchError(f"{table.where(key)}: {error}{hint}")


def _holds(entry: Table, scope: Mapping[str, Any]) -> bool:
    return _flag(entry, "if", scope, True) and not _flag(entry, "unless", scope)


def _flag(entry: Table, key: str, scope: Mapping[str, Any], default: bool = False) -> bool:
    value = _fill(entry, key, scope, default)
    if isinstance(value, str):
        return value.strip().lower() not in ("", "false", "no", "off", "0", "none", "null")
    return bool(value)


def _condition(entry: Table) -> str:
    return "; ".join(f"`{key}: {entry[key]}` says so" for key in ("if", "unless") if key in entry)


def _words(value: Any) -> list[Any]:
    if isinstance(value, str):
        return [word.strip() for word in value.split(",") if word.strip()]
    return list(value) if isinstance(value, list) else [] if value is None else [value]


def _ports(entry: Table, scope: Mapping[str, Any]) -> list[str]:
    """Returns the names under `keep:`. Raises LaunchError for what is no name."""
    names = _words(_fill(entry, "keep", scope, []))
    if strange := [name for name in names if not isinstance(name, str)]:
        raise LaunchError(f"{entry.where('keep')}: keep lists names of output ports, not {text_of(strange[0])[:60]}")
    return names


def _namespace(entry: Table, scope: Mapping[str, Any]) -> str:
    return text_of(_fill(entry, "namespace", scope, "")).strip("/")


def _join(*parts: str) -> str:
    return "/".join(part for part in parts if part)


def _check_name(what: str, name: str, where: str) -> None:
    """Refuses what cannot be the name of a log file and of a socket's peer."""
    size = len(name.encode(errors="surrogatepass"))
    if not name.rpartition("/")[2] or not name.isprintable() or size > MAX_NAME:
        raise LaunchError(
            f"{where}: a {what} is called '{name[:40]}'; its name must be 1 to {MAX_NAME} bytes of printable characters"
        )


def _check_names(nodes: list[NodeSpec]) -> None:
    seen: dict[str, NodeSpec] = {}
    for node in nodes:
        if node.name in seen:
            raise LaunchError(f"{node.where}: two nodes are called '{node.name}' (the other: {seen[node.name].where})")
        seen[node.name] = node
