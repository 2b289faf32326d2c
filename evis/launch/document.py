"""YAML that remembers where it stood: maps and lists with the file and line of every entry."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import yaml

MAX_BYTES = 1 << 20
"""Longest launch file accepted [bytes]."""


_KEYS = {"launch file": "`nodes:`, `include:`, `args:`", "scene file": "`cameras:`, `bodies:`, `materials:`, `lights:`"}


class LaunchError(ValueError):
    """A launch file or argument that cannot be carried out. The text starts with file:line where there is one."""


class Table(dict[str, Any]):
    """A YAML map. `lines`: the line of each key."""

    def __init__(self, file: str, line: int) -> None:
        super().__init__()
        self.file = file
        self.line = line
        self.lines: dict[str, int] = {}

    def where(self, key: str | None = None) -> str:
        """`file:line` of a key, or of the map itself."""
        return f"{self.file}:{self.lines.get(key, self.line) if key is not None else self.line}"

    def check_keys(self, known: Iterable[str], what: str) -> None:
        """Raise LaunchError for a key that `what` does not have."""
        names = list(known)
        for key in self:
            if key not in names:
                raise LaunchError(f"{self.where(key)}: {what} has no '{key}'; {nearest(key, names)}")


class Row(list[Any]):
    """A YAML list. `lines`: the line of each item."""

    def __init__(self, file: str, line: int) -> None:
        super().__init__()
        self.file = file
        self.line = line
        self.lines: list[int] = []


def nearest(name: str, known: Iterable[str]) -> str:
    """`did you mean 'x'?`, or the list of what there is."""
    names = list(known)
    near = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    return f"did you mean '{near[0]}'?" if near else f"there are {', '.join(names) or 'none'}"


def read(path: Path, what: str = "launch file") -> Table:
    """The top-level map of a launch file (or what `what` says). Raises LaunchError with file:line for anything else."""
    name = _short(path)
    try:
        if path.stat().st_size > MAX_BYTES:
            raise LaunchError(f"{name}: longer than {MAX_BYTES} bytes; this is not a {what}")
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise LaunchError(f"{name}: not UTF-8 text; this is not a {what}") from None
    except OSError as error:
        raise LaunchError(f"{name}: cannot be read: {error.strerror}") from None
    return parse(text, name, what)


def parse(text: str, name: str, what: str = "launch file") -> Table:
    """As `read`, from text; `name` stands for the file in errors."""
    loader = None
    try:
        loader = yaml.SafeLoader(text)
        node = loader.get_single_node()
        if node is None:
            raise LaunchError(f"{name}:1: the file is empty")
        value = _convert(loader, node, name, frozenset())
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = text.splitlines()[mark.line] if mark and mark.line < len(text.splitlines()) else ""
        hint = "; inside { } a text with ${...} needs quotes" if "${" in line else ""
        raise LaunchError(f"{name}:{mark.line + 1 if mark else 1}: not YAML: {error.problem}{hint}") from None
    except (yaml.YAMLError, ValueError) as error:
        if isinstance(error, LaunchError):
            raise
        raise LaunchError(f"{name}:1: not YAML: {str(error).splitlines()[0]}") from None
    finally:
        if loader is not None:
            loader.dispose()
    if not isinstance(value, Table):
        raise LaunchError(f"{name}:1: a {what} is a map with {_KEYS.get(what, 'names as keys')}")
    return value


def submap(table: Table, key: str) -> Table:
    """The map below `key`, an empty one when there is none. Raises LaunchError when it is something else."""
    value = table.get(key)
    if value is None:
        return Table(table.file, table.line)
    if not isinstance(value, Table):
        raise LaunchError(f"{table.where(key)}: `{key}` must be a map")
    return value


def _convert(loader: yaml.SafeLoader, node: yaml.Node, file: str, above: frozenset[int]) -> Any:
    line = node.start_mark.line + 1
    if id(node) in above:
        raise LaunchError(f"{file}:{line}: an alias refers to itself")
    if len(above) > 32:
        raise LaunchError(f"{file}:{line}: nested deeper than 32 levels")
    above = above | {id(node)}
    if isinstance(node, yaml.MappingNode):
        table = Table(file, line)
        for key_node, value_node in node.value:
            key_line = key_node.start_mark.line + 1
            if not isinstance(key_node, yaml.ScalarNode):
                raise LaunchError(f"{file}:{key_line}: a key must be a plain word")
            key = str(key_node.value)
            if key in table:
                raise LaunchError(f"{file}:{key_line}: '{key}' stands here twice (first in line {table.lines[key]})")
            table[key] = _convert(loader, value_node, file, above)
            table.lines[key] = key_line
        return table
    if isinstance(node, yaml.SequenceNode):
        row = Row(file, line)
        for item in node.value:
            row.append(_convert(loader, item, file, above))
            row.lines.append(item.start_mark.line + 1)
        return row
    value = loader.construct_object(node)
    if not isinstance(value, (str, int, float, bool, type(None))):
        return str(node.value)  # a date in YAML 1.1; here it is just text
    return value


def _short(path: Path) -> str:
    """The path as the user would type it: relative where it lies below the working directory."""
    try:
        return str(path.resolve().relative_to(Path.cwd()))
    except (ValueError, OSError):
        return str(path)
