"""Reads launch files: the includes they name and the arguments they take together."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from evis.config.document import LaunchError, Row, Table, read, submap
from evis.config.expression import ExpressionError, substitute
from evis.config.paths import find, names
from evis.config.removed import instead
from evis.config.suggestions import nearest
from evis.launch.arguments import Argument, declare

TOP_KEYS = ("description", "mode", "args", "recorded", "include", "nodes")
INCLUDE_KEYS = ("file", "args", "namespace", "if", "unless")
MAX_FILES = 100
"""Most files that a launch file is made of, one that is included twice counted twice."""


@dataclass
class LaunchFile:
    """Holds a launch file that has been read, with the files that it includes and the arguments that it takes."""

    path: Path
    table: Table
    includes: list[tuple[Table, LaunchFile]]
    arguments: dict[str, Argument]

    @property
    def description(self) -> str:
        """Returns one line about the graph."""
        return str(self.table.get("description", "")).strip()


def load(path: Path) -> LaunchFile:
    """Reads a launch file and all that it includes. Raises LaunchError with file:line."""
    return _load(path, (), iter(range(MAX_FILES - 1)))


def _load(path: Path, above: tuple[Path, ...], more: Iterator[int]) -> LaunchFile:
    """Reads a launch file and its includes. above: the files that lead to this one by theirs. more: one item for each
    file that may yet be read."""
    real = path.resolve()
    table = read(path)
    table.check_keys(TOP_KEYS, "a launch file")
    own = submap(table, "args")
    includes = []
    inherited: dict[str, Argument] = {}
    for entry in _entries(table):
        entry.check_keys(INCLUDE_KEYS, "an include")
        target = _include_path(entry, real)
        if target.resolve() in (*above, real):
            raise LaunchError(f"{entry.where('file')}: {target.name} includes itself")
        if next(more, None) is None:
            raise LaunchError(f"{entry.where('file')}: more than {MAX_FILES} files, each counted as often as included")
        child = _load(target, (*above, real), more)
        set_here = submap(entry, "args")
        for key in set_here:
            if key not in child.arguments:
                raise LaunchError(
                    f"{set_here.where(key)}: {target.name} has no argument '{key}'; {instead(key, child.arguments)}"
                )
        inherited |= {k: v for k, v in child.arguments.items() if k not in set_here}
        includes.append((entry, child))
    return LaunchFile(path, table, includes, declare(own, submap(table, "nodes"), inherited))


def _entries(table: Table) -> list[Table]:
    value = table.get("include")
    if value is None:
        return []
    rows = list(zip(value, value.lines)) if isinstance(value, Row) else [(value, table.lines["include"])]
    return [_entry(table.file, entry, line) for entry, line in rows]


def _entry(file: str, entry: Any, line: int) -> Table:
    """Gives an include as a map; a name alone stands for one with that `file`."""
    if isinstance(entry, str):
        named = Table(file, line)
        named["file"], named.lines["file"] = entry, line
        return named
    if not isinstance(entry, Table) or "file" not in entry:
        raise LaunchError(
            f"{file}:{line}: an include is the name of a launch file, or a map with `file:` (and `args:`)"
        )
    return entry


def _include_path(entry: Table, own: Path) -> Path:
    """Finds the file of an include: beside the file `own` that names it, else one that comes with evis."""
    folder = own.parent
    try:
        name = str(substitute(entry["file"], {}))
    except ExpressionError as error:
        where = entry.where("file")
        raise LaunchError(f"{where}: {error}; the file of an include cannot depend on arguments") from None
    if (path := folder / name).is_file():
        return path
    if (path := folder / f"{name}.yaml").is_file() and path.resolve() != own:
        return path
    if "/" not in name and (shipped := find("launch", name)) is not None:
        return shipped
    there = [*(p.name for p in sorted(folder.glob("*.yaml"))), *names("launch")]
    raise LaunchError(
        f"{entry.where('file')}: no file '{name}' in {folder} and no launch file of that name comes with evis; "
        f"{nearest(name, there)}"
    )
