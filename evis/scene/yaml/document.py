"""Reads the map that a scene file is, with the file that it includes; nothing in it is looked into."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

from evis.config.document import LaunchError, Row, Table, read
from evis.scene.errors import SceneError
from evis.scene.model import MODELS
from evis.scene.sources import note

_SECTIONS = ("materials", "world", "bodies", "lights")
"""What an included file adds to the scene's own; of the rest, the scene's own counts."""


def read_document(path: Path) -> Table:
    """Reads the map of a scene file with what it includes; of a model by itself, the one that it stands for.

    Raises SceneError.
    """
    if path.suffix.lower() in MODELS:
        return _bare(note(path))
    try:
        table = _read(path)
    except LaunchError as error:
        raise SceneError(str(error)) from None
    included = table.get("include")
    if included is None:
        return table
    other = path.parent / str(included)
    if not isinstance(included, str) or not other.is_file():
        raise SceneError(f"{table.where('include')}: include names {included}, which is not in {path.parent}")
    part = _read_part(other)
    for key, value in part.items():
        own = table.get(key)
        if own is None:
            table[key] = value
        elif key in _SECTIONS:
            table[key] = _merged(table, key, value, own)
        table.lines.setdefault(key, table.lines["include"])
    return table


def _bare(path: Path) -> Table:
    """The scene that a model is by itself; arguments are its further folders and, of an MJCF, where it starts."""
    table, arguments, assets = (Table(str(path), 1) for _ in range(3))
    table["mjcf"], table["args"], table["assets"] = path.name, arguments, "${assets}"
    assets.update(type="str", default="", help="folders beside its own from which it may read files, with commas")
    arguments["assets"] = assets
    if path.suffix.lower() == ".xml":
        start = Table(str(path), 1)
        start.update(type="str", default="auto", help="keyframe to start from: a name, a number, none, or auto: home")
        arguments["keyframe"], table["keyframe"] = start, "${keyframe}"
    return table


def _read(path: Path) -> Table:
    """The file's map, parsed once for as long as the file is as it was: planning asks for a scene many times."""
    stat = note(path).stat()
    parsed = _parsed(path, stat.st_mtime_ns, stat.st_size)
    table = Table(parsed.file, parsed.line)
    table.update(parsed)
    table.lines = dict(parsed.lines)
    return table


@lru_cache(maxsize=16)
def _parsed(path: Path, mtime_ns: int, size: int) -> Table:
    return read(path, "scene file")


def _read_part(path: Path) -> Table:
    """Reads a file for `include:`, which holds what several scenes share. Raises SceneError."""
    try:
        table = _read(path)
        table.check_keys((*_SECTIONS, "description", "environment", "environment_map"), "an included scene file")
    except LaunchError as error:
        raise SceneError(str(error)) from None
    table.pop("description", None)
    return table


def _merged(table: Table, key: str, part: Any, own: Any) -> Any:
    """What is included first, then the scene's own; of a map, the scene's own entry where both have one."""
    if isinstance(part, Table) and isinstance(own, Table):
        result = Table(own.file, own.line)
        result.update({**part, **own})
        result.lines = {**part.lines, **own.lines}
        return result
    if isinstance(part, Row) and isinstance(own, Row):
        rows = Row(own.file, own.line)
        rows.extend([*part, *own])
        rows.lines = [*part.lines, *own.lines]
        return rows
    raise SceneError(f"{table.where(key)}: {key} is not the same kind of thing here and in the included file")
