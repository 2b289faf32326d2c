"""Finds node types by name: `event_sensor` is `nodes.event_sensor.node:EventSensorNode`, loaded when a graph has
one."""

from __future__ import annotations

import functools
import importlib
import sys
import sysconfig
from pathlib import Path
from typing import Any

from evis.config.document import LaunchError
from evis.config.suggestions import nearest
from evis.neighbours import PACKAGES, ROOT
from evis.runtime.node import Node

_files: dict[str, list[str]] = {}
"""Module of a node that does not come with evis -> the files that were imported for it."""


@functools.cache
def types() -> tuple[str, ...]:
    """Lists the node types that come with evis."""
    return tuple(sorted(path.parent.name for path in Path(ROOT, "nodes").glob("*/node.py")))


def comes_with_evis(node_type: str) -> bool:
    """Tells whether the code of a type is evis's own; found out without importing anything."""
    if ":" not in node_type:
        return True
    top, *rest = node_type.partition(":")[0].split(".")
    return top in (*PACKAGES, "evis") and Path(ROOT, top, *rest).with_suffix(".py").is_file()


def files_of(target: str) -> list[str]:
    """Lists the files outside evis, Python and its packages that were imported for a node; its own module's first."""
    return _files.get(target.partition(":")[0], [])


def target_of(node_type: str) -> str:
    """Returns the dotted target of a type, or of a `package.module:Class` as it is."""
    if ":" in node_type:
        return node_type
    words = "".join(word.capitalize() for word in node_type.split("_"))
    return f"nodes.{node_type}.node:{words}Node"


def load(node_type: str, where: str, folder: Path | None = None) -> tuple[str, type[Node]]:
    """Loads the class of a node type and returns its target and itself. folder: where a launch file's own modules lie.
    Raises LaunchError.
    """
    if ":" not in node_type and node_type not in types():
        raise LaunchError(f"{where}: no node type '{node_type}'; {nearest(node_type, types())}")
    target = target_of(node_type)
    module_name, _, class_name = target.partition(":")
    if ":" in node_type and folder is not None and str(folder) not in sys.path:
        sys.path.append(str(folder))
    before = set(sys.modules)
    try:
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        raise LaunchError(f"{where}: node type '{node_type}': no module '{error.name}'") from None
    if not comes_with_evis(node_type):
        _note(module_name, module, before)
    found = getattr(module, class_name, None)
    if not (isinstance(found, type) and issubclass(found, Node)):
        known = [k for k, v in vars(module).items() if isinstance(v, type) and issubclass(v, Node) and v is not Node]
        raise LaunchError(f"{where}: {module_name} has no node class '{class_name}'; {nearest(class_name, known)}")
    return target, found


def _note(name: str, module: Any, before: set[str]) -> None:
    """Keeps which files the import of a module has brought; the second import of one brings none."""
    known = [Path(ROOT, package) for package in (*PACKAGES, "evis")]
    known += [Path(place).resolve() for place in sysconfig.get_paths().values()]
    new = [m for key, m in list(sys.modules.items()) if key not in before and m is not module]
    paths = [Path(file).resolve() for m in new if (file := getattr(m, "__file__", None))]
    others = sorted(
        str(path) for path in paths
        if "site-packages" not in path.parts and not any(path.is_relative_to(place) for place in known)
    )  # fmt: skip
    if name not in _files:
        _files[name] = [str(Path(module.__file__).resolve()), *others]
