"""Reads YAML and remembers where it stood: maps and lists with the file and line of every entry.

This is the one reader of YAML. It builds values from the parser's events, so that a hostile file is refused at the
line where it goes beyond a limit, before anything of it is built.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import yaml

from evis.config.suggestions import nearest
from evis.files.regular import other_than_file

MAX_BYTES = 1 << 20
"""Longest launch or scene file accepted [bytes]."""
MAX_VALUES = MAX_BYTES // 2
"""Most values of a file, keys included: as many as MAX_BYTES hold when written out. An alias counts as all that it
stands for, each time it is used."""
MAX_DEPTH = 32
"""Most levels of maps and lists within each other."""
MAX_TEXT = 10_000
"""Longest single value [characters]."""
MAX_BITS = 1023
"""Longest whole number, what a float can hold [bits]."""

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""libyaml where PyYAML was built with it, which reads a file of MAX_BYTES in 0.3 s instead of 20."""

_KEYS = {"launch file": "`nodes:`, `include:`, `args:`", "scene file": "`cameras:`, `bodies:`, `materials:`, `lights:`"}


class LaunchError(ValueError):
    """Says that a launch file or argument cannot be carried out. The text starts with file:line where there is one."""


class Table(dict[str, Any]):
    """Holds a YAML map. `lines`: the line of each key."""

    def __init__(self, file: str, line: int) -> None:
        super().__init__()
        self.file = file
        self.line = line
        self.lines: dict[str, int] = {}

    def where(self, key: str | None = None) -> str:
        """Returns `file:line` of a key, or of the map itself."""
        return f"{self.file}:{self.lines.get(key, self.line) if key is not None else self.line}"

    def check_keys(self, known: Iterable[str], what: str) -> None:
        """Raises LaunchError for a key that `what` does not have."""
        names = list(known)
        for key in self:
            if key not in names:
                raise LaunchError(f"{self.where(key)}: {what} has no '{key}'; {nearest(key, names)}")


class Row(list[Any]):
    """Holds a YAML list. `lines`: the line of each item."""

    def __init__(self, file: str, line: int) -> None:
        super().__init__()
        self.file = file
        self.line = line
        self.lines: list[int] = []


def read(path: Path, what: str = "launch file") -> Table:
    """Reads the top-level map of a launch file (or what `what` says). Raises LaunchError with file:line for anything
    else.
    """
    name = _short(path)
    if found := other_than_file(path):
        raise LaunchError(f"{name}: it is {found}, and a {what} must be a file")
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
    """Reads the top-level map of a text as `read` does of a file; `name` stands for the file in errors."""
    value = parse_value(text, name)
    if not isinstance(value, Table):
        raise LaunchError(f"{name}:1: a {what} is a map with {_KEYS.get(what, 'names as keys')}")
    return value


def parse_value(text: str, name: str) -> Any:
    """Parses a value written in YAML: Table, Row, text, number, true, false or null. Raises LaunchError with
    name:line.
    """
    if len(text) > MAX_BYTES:
        raise LaunchError(f"{name}: longer than {MAX_BYTES} characters")
    events: Any = yaml.parse(text, Loader=_LOADER)
    try:
        return _Values(events, name).document()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = text.splitlines()[mark.line] if mark and mark.line < len(text.splitlines()) else ""
        hint = "; inside { } a text with ${...} needs quotes" if "${" in line else ""
        if "\t" in line[: len(line) - len(line.lstrip())]:
            hint = "; a tab stands before it, and YAML is indented with spaces"
        raise LaunchError(f"{name}:{mark.line + 1 if mark else 1}: {_told(str(error.problem))}{hint}") from None
    except yaml.YAMLError as error:
        raise LaunchError(f"{name}:1: {_told(str(error).splitlines()[0])}") from None
    finally:
        events.close()


def _told(problem: str) -> str:
    """What is wrong with a text that is not YAML, or too deep for libyaml, which from 0.2.6 on has a limit of its own
    and comes to it before it gives the events within MAX_DEPTH."""
    return f"nested deeper than {MAX_DEPTH} levels" if "nesting depth" in problem else f"not YAML: {problem}"


def submap(table: Table, key: str) -> Table:
    """Returns the map below `key`, an empty one when there is none. Raises LaunchError when it is something else."""
    value = table.get(key)
    if value is None:
        return Table(table.file, table.line)
    if not isinstance(value, Table):
        raise LaunchError(f"{table.where(key)}: `{key}` must be a map")
    return value


_POWER_OF_TEN = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+")
"""Numbers in YAML 1.2 that YAML 1.1 takes for text unless they have both a point and a sign: 1e6, 1.0e6, 1e-3."""


_AS_TEXT = {f"tag:yaml.org,2002:{kind}" for kind in ("timestamp", "value", "merge")}
"""What YAML 1.1 takes for more than a text and nobody means here: 2026-01-31 and also 2026-31-01, = and <<."""


class _Scalars(yaml.constructor.SafeConstructor, yaml.resolver.Resolver):
    """What a plain word means in YAML 1.1, and numbers in YAML 1.2."""

    def __init__(self) -> None:
        yaml.constructor.SafeConstructor.__init__(self)
        yaml.resolver.Resolver.__init__(self)

    def value(self, event: Any) -> Any:
        """Returns a value of a plain type. Raises yaml.YAMLError and what PyYAML's conversions raise."""
        tag = event.tag
        if tag in (None, "!"):
            tag = self.resolve(yaml.ScalarNode, event.value, event.implicit)
            if event.implicit[0] and _POWER_OF_TEN.fullmatch(event.value):
                return float(event.value)
            if tag in _AS_TEXT:
                return str(event.value)
        value = self.construct_object(yaml.ScalarNode(tag, event.value, event.start_mark, event.end_mark))
        self.constructed_objects.clear()
        return value if isinstance(value, (str, int, float, bool, type(None))) else str(event.value)


class _Values:
    """Maps, lists and plain values from the events of a YAML parser, within the limits at the top of this file."""

    def __init__(self, events: Iterator[Any], file: str) -> None:
        self._events, self._file = events, file
        self._scalars = _Scalars()
        self._anchors: dict[str, tuple[Any, int] | None] = {}
        self._count = 0

    def document(self) -> Any:
        """Returns the only document of the text. Raises LaunchError, yaml.YAMLError."""
        next(self._events)  # the stream's start
        if isinstance(event := next(self._events), yaml.StreamEndEvent):
            raise LaunchError(f"{self._file}:1: the file is empty")
        value = self._value(next(self._events), 1)
        next(self._events)  # the document's end
        if not isinstance(event := next(self._events), yaml.StreamEndEvent):
            raise self._error(event, "a second document begins here; a file holds one")
        return value

    def _error(self, event: Any, text: str) -> LaunchError:
        return LaunchError(f"{self._file}:{event.start_mark.line + 1}: {text}")

    def _counted(self, event: Any, values: int) -> None:
        self._count += values
        if self._count > MAX_VALUES:
            told = "an alias counts as all that it stands for"
            raise self._error(event, f"more than {MAX_VALUES} values up to here; {told}")

    def _value(self, event: Any, depth: int) -> Any:
        """The value that begins with this event."""
        if isinstance(event, yaml.AliasEvent):
            if event.anchor not in self._anchors:
                raise self._error(event, f"no anchor '&{event.anchor}' stands before the alias '*{event.anchor}'")
            known = self._anchors[event.anchor]
            if known is None:
                raise self._error(event, "an alias refers to itself")
            self._counted(event, known[1])
            return known[0]
        before = self._count
        self._counted(event, 1)
        if event.anchor is not None:
            self._anchors[event.anchor] = None
        if isinstance(event, yaml.ScalarEvent):
            value = self._scalar(event)
        elif depth > MAX_DEPTH:
            raise self._error(event, f"nested deeper than {MAX_DEPTH} levels")
        elif event.tag not in (None, "!", "tag:yaml.org,2002:map", "tag:yaml.org,2002:seq"):
            raise self._error(event, f"a map or list with the tag '{event.tag}' has no meaning here")
        else:
            value = self._map(event, depth) if isinstance(event, yaml.MappingStartEvent) else self._list(event, depth)
        if event.anchor is not None:
            self._anchors[event.anchor] = (value, self._count - before)
        return value

    def _map(self, start: Any, depth: int) -> Table:
        table = Table(self._file, start.start_mark.line + 1)
        while not isinstance(event := next(self._events), yaml.MappingEndEvent):
            line = event.start_mark.line + 1
            if not isinstance(event, yaml.ScalarEvent):
                raise self._error(event, "a key must be a plain word")
            self._counted(event, 1)
            self._check_length(event)
            key = str(event.value)
            if key == "<<":
                told = "`<<` joins no maps here; write the keys out, or give a whole map as *NAME"
                raise self._error(event, told)
            if key in table:
                raise self._error(event, f"'{key}' stands here twice (first in line {table.lines[key]})")
            table[key] = self._value(next(self._events), depth + 1)
            table.lines[key] = line
        return table

    def _list(self, start: Any, depth: int) -> Row:
        row = Row(self._file, start.start_mark.line + 1)
        while not isinstance(event := next(self._events), yaml.SequenceEndEvent):
            row.append(self._value(event, depth + 1))
            row.lines.append(event.start_mark.line + 1)
        return row

    def _scalar(self, event: Any) -> Any:
        self._check_length(event)
        try:
            value = self._scalars.value(event)
        except (ValueError, ArithmeticError, LookupError, AttributeError):  # of PyYAML's conversions
            raise self._error(
                event, f"'{event.value:.40}' cannot be read as the number or date it looks like"
            ) from None
        if isinstance(value, int) and value.bit_length() > MAX_BITS:
            raise self._error(event, f"'{event.value:.40}' is a whole number of more than {MAX_BITS} bits")
        return value

    def _check_length(self, event: Any) -> None:
        if len(event.value) > MAX_TEXT:
            raise self._error(event, f"a value of {len(event.value)} characters; the most is {MAX_TEXT}")


def _short(path: Path) -> str:
    """The path as the user would type it: relative where it lies below the working directory."""
    try:
        return str(path.resolve().relative_to(Path.cwd()))
    except (ValueError, OSError):
        return str(path)
