"""Declares the arguments of a launch file with type, default, range and help, and reads those given as key:=value."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from evis.config.document import LaunchError, Row, Table, submap
from evis.config.expression import ExpressionError, Room, UnknownName, substitute
from evis.config.params import Param, ParamError
from evis.config.removed import instead
from evis.config.suggestions import nearest
from evis.launch import node_arguments

TYPES: dict[str, type] = {"int": int, "float": float, "str": str, "bool": bool, "list": list}
KEYS = ("type", "default", "choices", "min", "max", "help", "unit", "secret", "by", "of", "also", "required")
OPTIONS = ("duration", "record", "record_topics", "record_sync", "view")
"""Names that stand for command line options in every launch file: --duration, --record, --record-topics, --record-sync,
--no-view."""


class ArgumentError(LaunchError):
    """Says that what the user gave for an argument is wrong."""


@dataclass(frozen=True)
class Argument:
    """Describes one declared argument. required: it has no default. where: file:line. by: another argument, and the
    defaults that some values of that one bring (`by: {preset: {dvs128: 128}}`).
    """

    name: str
    param: Param
    required: bool
    where: str
    by: tuple[str, Mapping[Any, Any]] = field(default=("", MappingProxyType({})))


def declare(table: Table, nodes: Table, inherited: Mapping[str, Argument]) -> dict[str, Argument]:
    """Collects the `args:` of a file, those of its `nodes:` that it names and the inherited ones. Raises LaunchError.

    A name that a node or an included file declares too only changes what it says anew.
    """
    params = node_arguments.offered(table, nodes, OPTIONS)
    base = {name: Argument(name, param, False, table.where("of")) for name, param in params.items()} | dict(inherited)
    declared: dict[str, Argument] = {}
    for name in table:
        if name == "of" and isinstance(table[name], Row):
            continue
        where = table.where(name)
        entry = table[name]
        if not isinstance(entry, Table):
            raise LaunchError(f"{where}: argument '{name}' must be a map such as {{default: 1, help: ...}}")
        entry.check_keys(KEYS, f"argument '{name}'")
        if not name.isidentifier() or name in OPTIONS:
            raise LaunchError(f"{where}: '{name}' cannot be the name of an argument")
        param = node_arguments.source_of(entry, nodes)
        source = Argument(name, param, False, where) if param else base.get(name)
        declared[name] = _argument(name, entry, nodes, where, source)
    return {**declared, **{name: argument for name, argument in base.items() if name not in declared}}


def _argument(name: str, entry: Table, nodes: Table, where: str, base: Argument | None) -> Argument:
    default = entry.get("default", base.param.default if base else None)
    if "type" in entry:
        if entry["type"] not in TYPES:
            raise LaunchError(f"{entry.where('type')}: no type '{entry['type']}'; {nearest(str(entry['type']), TYPES)}")
        kind = TYPES[entry["type"]]
    elif base:
        kind = base.param.type
    else:
        kind = type(default) if type(default) in TYPES.values() else list if isinstance(default, list) else str
    secret = entry.get("secret", bool(base and base.param.secret))
    if not isinstance(secret, bool) or (secret and kind is not str):
        raise LaunchError(f"{entry.where('secret')}: secret must be true or false, and only a text can be one")
    choices = entry.get("choices", list(base.param.choices) if base else [])
    if not isinstance(choices, list):
        raise LaunchError(f"{entry.where('choices')}: choices must be a list")
    also = submap(entry, "also")
    words = base.param.words if base else ()
    if kind in (int, float):
        words = (*words, *also)
    else:
        choices = [*choices, *also]
    required = entry.get("required", "default" not in entry and (base is None or base.required)) is True
    param = Param(
        type=kind,
        default=default,
        help=", ".join([str(entry.get("help", base.param.help if base else "")), *_named(also)]),
        unit=str(entry.get("unit", base.param.unit if base else "")),
        minimum=_limit(entry, "min", base.param.minimum if base else None),
        maximum=_limit(entry, "max", base.param.maximum if base else None),
        choices=tuple(choices),
        optional=not required and default is None,
        secret=secret,
        files=base.param.files if base and "choices" not in entry else (),
        words=words,
    )
    return Argument(name, param, required, where, _by(name, entry, nodes, base))


def _named(also: Table) -> list[str]:
    """Words further choices, or texts in place of a number, with what each means, as a help text has them."""
    return [f"{choice} = {meaning}" for choice, meaning in also.items()]


def _by(name: str, entry: Table, nodes: Table, base: Argument | None) -> tuple[str, Mapping[Any, Any]]:
    """Reads what `by:` says; an inherited one holds unless the default is declared anew."""
    if "by" not in entry:
        return base.by if base and "default" not in entry else ("", {})
    value = entry["by"]
    if isinstance(value, str):
        return node_arguments.brought_by(value, name, nodes, entry.where("by"))
    if not (isinstance(value, Table) and len(value) == 1 and isinstance(table := value[next(iter(value))], Table)):
        raise LaunchError(
            f"{entry.where('by')}: by must be NODE.PARAMETER, or a map such as {{preset: {{dvs128: 128}}}}"
        )
    return str(next(iter(value))), dict(table)


def _limit(entry: Table, key: str, inherited: float | None) -> float | None:
    value = entry.get(key, inherited)
    if value is not None and (isinstance(value, bool) or not isinstance(value, (int, float))):
        raise LaunchError(f"{entry.where(key)}: {key} must be a number")
    return value


def resolve(
    file: str, declared: Mapping[str, Argument], given: Mapping[str, Any], room: Room | None = None
) -> dict[str, Any]:
    """Resolves every declared argument's value: the given ones converted and checked, the others at their defaults.

    A default may use environment variables and arguments that stand before it. room: as of `substitute`.

    Raises LaunchError naming the nearest argument for one that the file does not have.
    """
    for key in given:
        if key not in declared:
            raise ArgumentError(
                f"{file} has no argument '{key}'; {option_for(key, given[key]) or instead(key, declared)}"
            )
    values: dict[str, Any] = {}
    room = room or Room()
    for name, argument in declared.items():
        try:
            value = given[name] if name in given else substitute(argument.param.default, values, room)
            if name not in given and argument.required:
                raise ArgumentError(f"{argument.where}: {file} needs the argument {name}:=... ({argument.param.help})")
            values[name] = argument.param.convert("argument", name, value)
            if argument.required and values[name] == "":
                raise ArgumentError(f"{file}: {name} is empty; it must be given ({argument.param.help})")
        except (ParamError, ExpressionError) as error:
            if name in given:
                raise ArgumentError(f"{file}: {error}") from None
            raise LaunchError(f"{argument.where}: {error}{_later(error, name, declared)}") from None
    for name, (other, value) in brought(declared, values, given).items():
        try:
            values[name] = declared[name].param.convert("argument", name, value)
        except ParamError as error:
            raise LaunchError(f"{declared[name].where}: by {other}: {error}") from None
    return values


def _later(error: Exception, name: str, declared: Mapping[str, Argument]) -> str:
    """Words the remedy for a default that uses an argument which it does not find."""
    if not isinstance(error, UnknownName):
        return ""
    if error.name in declared and error.name != name:
        return f" before '{name}'; name {error.name} before it, as `{error.name}: {{}}` if it is an included file's"
    return f"; {nearest(error.name, list(declared)[: list(declared).index(name)])}"


def option_for(name: str, value: Any) -> str:
    """Gives the remedy for a name that stands for an option of the command line, "" for any other."""
    if name not in OPTIONS:
        return ""
    switches = {"view": "--no-view", "record_sync": "--record-sync"}
    option = switches.get(name) or f"--{name.replace('_', '-')} {value}"
    return f"it is an option of the command line: {option}"


def brought(
    declared: Mapping[str, Argument], values: Mapping[str, Any], given: Mapping[str, Any]
) -> dict[str, tuple[str, Any]]:
    """Finds the arguments that are not given and whose default another argument's value brings: name -> (other,
    default).
    """
    found: dict[str, tuple[str, Any]] = {}
    for name, argument in declared.items():
        other, table = argument.by
        if name not in given and other in values and values[other] in table:
            found[name] = other, table[values[other]]
    return found


def parse_pairs(words: Sequence[str], mark: str = ":=", named: str = "key", example: str = "seed:=3") -> dict[str, str]:
    """Parses words such as `key:=value` into a map. Raises ArgumentError for any other word, and for a key that comes
    twice.

    mark: between key and value. named: what a key is, and example: of a word, for the error.
    """
    pairs: dict[str, str] = {}
    for word in words:
        key, between, value = word.partition(mark)
        if not between or not key:
            raise ArgumentError(f"'{word}' is not {named}{mark}value, as in {example}")
        if key in pairs:
            raise ArgumentError(f"{key} is given twice, as {pairs[key]} and {value}")
        # A shell leaves ~ alone behind such a mark.
        pairs[key] = os.path.expanduser(value) if value.startswith("~/") else value
    return pairs
