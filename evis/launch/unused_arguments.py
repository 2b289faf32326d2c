"""Reports arguments that a user gave and that change nothing: before the start, never ignored in silence."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from itertools import chain, combinations
from typing import Any

from evis.config.document import LaunchError, Table, submap
from evis.config.expression import ExpressionError, names_in, substitute
from evis.config.params import describe_value, resolve
from evis.launch import node_arguments
from evis.launch.arguments import ArgumentError
from evis.launch.catalog import load
from evis.launch.expand import Expanded, NodeSpec, turns
from evis.launch.files import LaunchFile
from evis.launch.graph.sharing import named_in_share
from evis.runtime.plan import Plan

BESIDE = ("params", "otherwise", "spares")
"""Keys of a node's entry of which params are looked at one by one, and the others are only told."""
CONDITIONS = ("if", "unless")
"""Keys of a node's entry that say whether it is there."""
_REMEDIES = {
    "duration": "write `duration: ${duration}` among the params of its source, if that has such a parameter",
    "record": 'add a node `recorder: {type: recorder, params: {path: "${record}"}}`',
}
"""Options of the command line that a launch file must hand on, and how it does."""


def check_effect(launch: LaunchFile, given: Collection[str], expanded: Expanded, plan: Plan) -> None:
    """Raises ArgumentError naming the first of the `given` arguments that has no effect, and why.

    One that is off anyway (0, false, an empty text or list) is never held against the user.
    """
    there: dict[str, list[NodeSpec]] = {}
    for spec in expanded.nodes:
        there.setdefault(spec.where, []).append(spec)
    for name in given:
        value = expanded.values.get(name)
        reasons = list(_uses(launch, name, given, there, expanded, plan))
        if value and reasons and all(reasons):
            text = ",".join(map(str, value)) if isinstance(value, list) else value
            text = describe_value(value) if isinstance(value, bool) else text
            raise ArgumentError(f"{name}:={text} has no effect: {'; '.join(dict.fromkeys(reasons))}; leave it out")


def check_options(launch: LaunchFile, options: Mapping[str, Any]) -> None:
    """Raises ArgumentError naming the first option of the command line that no file of the graph hands to a node: with
    it nothing would end after --duration, or be recorded.
    """
    for name, remedy in _REMEDIES.items():
        if options.get(name) and name not in _named_anywhere(launch):
            raise ArgumentError(
                f"--{name} {options[name]} has no effect: {launch.path.name} gives it to no node; {remedy}"
            )


def _named_anywhere(launch: LaunchFile) -> set[str]:
    """Names that a file, or one that it includes, asks for in `${...}`."""
    return names_in(launch.table).union(*(_named_anywhere(child) for _, child in launch.includes))


def _uses(
    launch: LaunchFile,
    name: str,
    given: Collection[str],
    there: Mapping[str, list[NodeSpec]],
    expanded: Expanded,
    plan: Plan,
) -> Iterator[str]:
    """Says for each use of an argument in a file why it changes nothing, "" where it does."""
    table = launch.table
    if any(name in names_in(table[key]) for key in ("mode", "recorded", "args") if key in table):
        yield ""
    for entry, child in launch.includes:
        if any(name in names_in(entry[key]) for key in ("if", "unless", "namespace") if key in entry):
            yield ""
        set_here = submap(entry, "args")
        inner = [key for key in set_here if name in names_in(set_here[key])]
        for key in inner:
            yield from _uses(child, key, given, there, expanded, plan)
        if name in child.arguments and name not in set_here:
            # Left out, it has the default of the file that hands it on.
            defaults = child.arguments | {name: launch.arguments[name]}
            yield from _uses(replace(child, arguments=defaults), name, given, there, expanded, plan)
    nodes = submap(table, "nodes")
    for key in nodes:
        entry = nodes[key]
        for part in (part for part in entry if part not in BESIDE and name in names_in(entry[part])):
            if part not in CONDITIONS and nodes.where(key) not in there:
                yield f"{key} is left out, for {_why(key, expanded)}"
            elif part not in CONDITIONS or _decides(entry, part, name, given, launch, expanded):
                yield ""
        params = submap(entry, "params")
        read = [param for param in params if name in names_in(params[param])]
        read = [param for param in read if _differs(entry, params[param], name, launch, expanded.values)]
        read += node_arguments.passed_on(entry, {name: None}, nodes.where(key))
        if not read:
            continue
        specs = there.get(nodes.where(key), [])
        if not specs:
            yield f"{key} is left out, for {_why(key, expanded)}"
        for spec in specs:
            for param in read:
                yield _idle(spec, param, plan)


def _differs(entry: Table, text: Any, name: str, launch: LaunchFile, values: Mapping[str, Any]) -> bool:
    """Tells whether an argument makes another value of what a parameter or a condition of a node's entry is made from.

    In any turn of its `foreach`, as far as can be told: of one that is given its default nothing can.
    """
    if name not in launch.arguments or values.get(name) == launch.arguments[name].param.default:
        return True
    left_out = {**values, name: launch.arguments[name].param.default}
    try:
        with_it, without = (
            [substitute(text, scope) for *_, scope in turns(entry, held)] for held in (values, left_out)
        )
    except (ExpressionError, LaunchError):
        return True
    return with_it != without


def _decides(
    entry: Table, part: str, name: str, given: Collection[str], launch: LaunchFile, expanded: Expanded
) -> bool:
    """Tells whether an argument has a part in a condition of an entry: by itself or, of several that each suffice,
    beside the others.

    Of two that each leave a node out neither does it alone, so any of the others that are given may be taken away.
    """
    text = entry[part]
    others = [other for other in given if other != name and other in names_in(text) and other in launch.arguments]
    taken = chain.from_iterable(combinations(others, count) for count in range(len(others) + 1))
    for away in taken:
        values = expanded.values | {other: launch.arguments[other].param.default for other in away}
        if _differs(entry, text, name, launch, values):
            return True
    return False


def _idle(spec: NodeSpec, param: str, plan: Plan) -> str:
    """Says why a parameter of a node that is there changes nothing, or ""."""
    # Where several devices share a node, one of its shares stands for all.
    planned = plan.nodes.get(spec.name) or plan.nodes.get(named_in_share(spec.name, 0))
    if planned is None:
        return next(
            (f"{item.what} is left out, for {item.why}" for item in plan.left_out if item.what == spec.name), ""
        )
    _, cls = load(planned.target, spec.where)
    return cls.without_effect(planned.params).get(param, "")


def check_parameters(cls: Any, name: str, given: Mapping[str, Any]) -> None:
    """Checks in the same way parameters that a user gave to one node, and that they go together. Raises ArgumentError,
    ParamError.
    """
    params = resolve(name, cls.PARAMS, given)
    idle = cls.without_effect(params)
    for key in given:
        if key in idle and params[key]:
            raise ArgumentError(f"{key}:={given[key]} has no effect: {idle[key]}; leave it out")
    try:
        cls.needs(params, frozenset(cls.OUTPUTS.keys() - cls.missing(params).keys()))
    except ValueError as error:
        raise ArgumentError(f"'{name}': {error}") from None


def _why(node: str, expanded: Expanded) -> str:
    """Finds the reason of a node that is not there; `foreach` and includes put more about its name."""
    names = (full for full in expanded.absent if full == node or full.rpartition("/")[2].startswith(node))
    return next((expanded.absent[full] for full in names), "its condition does not hold")
