"""Node types by name: `event_sensor` is `nodes.event_sensor.node:EventSensorNode`, loaded when a graph has one."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from pathlib import Path

from evis.launch.document import LaunchError, nearest
from evis.node import Node


def types() -> list[str]:
    """The node types that come with evis."""
    spec = importlib.util.find_spec("nodes")
    if spec is None or not spec.submodule_search_locations:
        return []
    folders = [Path(place) for place in spec.submodule_search_locations]
    return sorted({p.parent.name for folder in folders for p in folder.glob("*/node.py")})


def target_of(node_type: str) -> str:
    """The dotted target of a type, or of a `package.module:Class` as it is."""
    if ":" in node_type:
        return node_type
    words = "".join(word.capitalize() for word in node_type.split("_"))
    return f"nodes.{node_type}.node:{words}Node"


def load(node_type: str, where: str, folder: Path | None = None) -> tuple[str, type[Node]]:
    """Target and class of a type. folder: where a launch file's own modules lie. Raises LaunchError."""
    if ":" not in node_type and node_type not in types():
        raise LaunchError(f"{where}: no node type '{node_type}'; {nearest(node_type, types())}")
    target = target_of(node_type)
    module_name, _, class_name = target.partition(":")
    if ":" in node_type and folder is not None and str(folder) not in sys.path:
        sys.path.append(str(folder))
    try:
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        raise LaunchError(f"{where}: node type '{node_type}': no module '{error.name}'") from None
    found = getattr(module, class_name, None)
    if not (isinstance(found, type) and issubclass(found, Node)):
        known = [k for k, v in vars(module).items() if isinstance(v, type) and issubclass(v, Node) and v is not Node]
        raise LaunchError(f"{where}: {module_name} has no node class '{class_name}'; {nearest(class_name, known)}")
    return target, found
