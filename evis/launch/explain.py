"""Describes a plan for people: nodes by process, edges, what is left out and why."""

from __future__ import annotations

import dataclasses
from typing import Any

from evis.launch.graph.batching import BATCH
from evis.runtime.plan import Plan


def as_text(plan: Plan) -> str:
    """Writes what `evis launch --explain` prints."""
    plan = plan.redacted()
    lines = [f"{plan.name}: {plan.mode}" + (f", {plan.duration_s:g} s" if plan.duration_s else "")]
    if plan.args:
        lines += [
            "",
            "arguments",
            *(f"  {k} = {_shown(v)}{_of(plan, k)}" for k, v in plan.args.items() if v is not None),
        ]
    if plan.chosen:
        lines += ["", "chosen", *(f"  {k}: {_shown(v)}" for k, v in plan.chosen.items())]
    if plan.random:
        drawn = [f"  {name}: {', '.join(what)}" for name, what in plan.random.items() if what]
        lines += ["", f"random, by seed {plan.seed}", *(drawn or ["  nothing: every seed gives the same run"])]
    if plan.warnings:
        lines += ["", "warnings", *(f"  {name}: {line}" for name, said in plan.warnings.items() for line in said)]
    lines += ["", "keyframes at once", f"  {_at_once(plan)}", "", "processes"]
    for process, nodes in plan.processes().items():
        lines.append(f"  {process}")
        for node in nodes:
            shown = ", ".join(f"{k}={_shown(v)}" for k, v in node.params.items() if v is not None)
            lines.append(f"    {node.name}  ({node.target})  {shown}".rstrip())
    if plan.unknown:
        lines += ["", "unknown, for their code was not loaded"]
    for said in plan.unknown:
        lines.append(f"  {said['name']}  ({said['type']}, {said['where']})")
        lines += [f"    {key}: {_said(value)}" for key, value in said.items() if key not in ("name", "type", "where")]
    dormant = [n.name for n in plan.nodes.values() if n.dormant]
    if dormant:
        lines += ["", "started when a viewer asks", *(f"  {name}" for name in dormant)]
    lines += ["", "topics"]
    for topic in plan.topics.values():
        readers = ", ".join(f"{e.node}" + ("" if e.kind == "lockstep" else f" ({e.kind})") for e in topic.edges)
        lines.append(f"  {topic.name}  [{topic.type}]  {topic.node} -> {readers or 'viewers only'}")
    if plan.imports:
        lines += ["", "imported from outside evis", *(f"  {file}" for file in plan.imports)]
    if plan.unknown:
        lines += ["", "an unknown node may read what nobody else does, and publish what is missing here"]
    lines += ["", "left out", *(f"  {item.what}: {item.why}" for item in plan.left_out)]
    return "\n".join(lines)


def as_dict(plan: Plan) -> dict[str, Any]:
    """Returns the plan as plain values, for --explain --json."""
    body = dataclasses.asdict(plan.redacted())
    for key in ("run_id", "directory", "secrets"):
        body.pop(key)
    body["processes"] = {process: [n.name for n in nodes] for process, nodes in plan.processes().items()}
    return body


def _at_once(plan: Plan) -> str:
    if plan.single:
        return f"one, for {plan.single}"
    given = [node.params[BATCH] for node in plan.nodes.values() if node.params.get(BATCH)]
    if given:
        return f"{given[0]}"
    until = f"; one at a time once a program attaches, for {plan.waits}" if plan.waits else ""
    return f"as many as pay, which nodes find at the start (batch:=N gives another number){until}"


def _said(value: Any) -> str:
    return ", ".join(f"{k}={_shown(v)}" for k, v in value.items()) if isinstance(value, dict) else _shown(value)


def _of(plan: Plan, name: str) -> str:
    return f"  ({plan.brought[name]} brings it)" if name in plan.brought else ""


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, list):
        return "[" + ", ".join(map(str, value)) + "]"
    return "none" if value is None else str(value)
