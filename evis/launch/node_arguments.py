"""Declares arguments of a launch file that are parameters of its nodes: declared by the node, and passed on under their
name.

    args: {of: [event_sensor], defocus: {of: event_sensor.defocus_px}}
    nodes:
      event_sensor: {type: event_sensor, params: {from: args, defocus_px: "${defocus}"}}

`of: [NODE, ...]` makes an argument of every parameter that the node's own `params:` do not set; `of: NODE.PARAMETER` in
an argument's entry takes type, default, range, unit and help of that one. `from: args` gives the node every argument
and variable of `foreach` that is called as one of its parameters. Both are for nodes that come with evis: a launch
file with others may be looked at without loading them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from evis.config.document import LaunchError, Row, Table, submap
from evis.config.params import Param
from evis.config.suggestions import nearest
from evis.launch import catalog
from evis.runtime.node import Node

OF = "of"
FROM = "from"


def offered(args: Table, nodes: Table, reserved: tuple[str, ...]) -> dict[str, Param]:
    """Collects the parameters that `of: [...]` makes arguments; of one that several nodes have, the first node's.

    reserved: names that no argument may have. Raises LaunchError.
    """
    found: dict[str, Param] = {}
    if not isinstance(args.get(OF), Row):
        return found
    for name in args[OF]:
        node = _node(nodes, str(name), args.where(OF))
        own = {*submap(node, "params"), *submap(node, "foreach"), *submap(node, "lookup"), *reserved}
        for key, param in class_of(node, nodes.where(str(name))).PARAMS.items():
            if key not in own:
                found.setdefault(key, param)
    return found


def source_of(entry: Table, nodes: Table) -> Param | None:
    """Finds the parameter that an argument's entry names by `of: NODE.PARAMETER`. Raises LaunchError."""
    if OF not in entry:
        return None
    where = entry.where(OF)
    node, _, key = str(entry[OF]).partition(".")
    known = class_of(_node(nodes, node, where), where).PARAMS
    if key not in known:
        raise LaunchError(f"{where}: node '{node}' has no parameter '{key}'; {nearest(key, known)}")
    return known[key]


def brought_by(text: str, argument: str, nodes: Table, where: str) -> tuple[str, dict[Any, Any]]:
    """Returns the parameter of `by: NODE.PARAMETER`, and what its values bring for an argument. Raises LaunchError."""
    node, _, key = text.partition(".")
    table = class_of(_node(nodes, node, where), where).BRINGS.get(key, {})
    return key, {value: defaults[argument] for value, defaults in table.items() if argument in defaults}


def passed_on(entry: Table, scope: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Returns the parameters that a node's entry with `params: {from: args}` takes: those in scope and not set
    there.
    """
    params = submap(entry, "params")
    if not takes_arguments(params):
        return {}
    return {key: scope[key] for key in class_of(entry, where).PARAMS if key in scope and key not in params}


def takes_arguments(params: Table) -> bool:
    """Tells whether a node's `params:` say `from: args`."""
    return bool(params.get(FROM) == "args")


def class_of(entry: Table, where: str) -> type[Node]:
    """Returns the class of a node's entry. Raises LaunchError unless it comes with evis and is named without
    `${...}`.
    """
    kind = str(entry.get("type", ""))
    if not kind or "${" in kind or not catalog.comes_with_evis(kind):
        raise LaunchError(f"{where}: `of` and `from` are for node types that come with evis, not '{kind}'")
    return catalog.load(kind, where)[1]


def _node(nodes: Table, name: str, where: str) -> Table:
    if not isinstance(nodes.get(name), Table):
        raise LaunchError(f"{where}: `nodes:` has no '{name}'; {nearest(name, nodes)}")
    entry: Table = nodes[name]
    return entry
