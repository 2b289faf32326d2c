"""Writes the launch file of a plan with every argument filled in, which a bag keeps and `evis launch` can run again."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import yaml

from evis.config.secret import Redactor
from evis.launch.expand import Expanded, NodeSpec
from evis.launch.graph.wiring import WiredNode


def resolved_file(expanded: Expanded, nodes: Sequence[WiredNode], hide: Redactor) -> str:
    """Writes the launch file as YAML, with every argument filled in and no secret."""
    body: dict[str, Any] = {"description": expanded.description or expanded.file, "mode": expanded.mode, "nodes": {}}
    for node in nodes:
        spec = node.spec
        name = spec.name.removeprefix(f"{spec.namespace}/")
        entry: dict[str, Any] = {"type": spec.type, "params": _plain_values(node), "process": spec.process}
        extras = {"remap": spec.remap, "namespace": spec.namespace, "respawn": spec.respawn, "keep": spec.keep}
        flags = {"tap": spec.tap, "on_demand": spec.on_demand}
        body["nodes"][name] = entry | {k: v for k, v in (extras | flags).items() if v}
    return yaml.safe_dump(hide.value(body), sort_keys=False, width=120)


def _plain_values(node: WiredNode) -> dict[str, Any]:
    """Its parameters but those that are not given. Secret ones are left out, so that the file can be run again."""
    return {k: v for k, v in node.params.items() if v is not None and not node.cls.PARAMS[k].secret}


def as_written(spec: NodeSpec) -> dict[str, Any]:
    """Gives what a launch file says of a node, as far as it says anything."""
    return {key: value for key, value in dataclasses.asdict(spec).items() if value and key != "param_lines"}
