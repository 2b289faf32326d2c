"""Implements `evis node`, which describes the nodes of a running graph, or what a node type can do."""

from __future__ import annotations

import argparse
import json
from typing import Any

from evis.cli.actions import adder
from evis.cli.graph.attach import add_run_option, find_run, listen
from evis.cli.parser import Parser, UsageError
from evis.client.running import running_graphs
from evis.config.params import describe
from evis.console.printable import all_printable, printable

HELP = "list and describe the nodes of a running graph"
EXAMPLES = {"list": "evis node list --json", "info": "evis node info event_sensor"}
EXAMPLE = f"example: {EXAMPLES['info']}"


def add_arguments(parser: Parser) -> None:
    """Declares the command's arguments."""
    add = adder(parser, EXAMPLES)
    listing = add("list", "running graphs, and the nodes and processes of one")
    info = add("info", "parameters, topics and state of one node, or what a node type can do")
    info.add_argument("node", metavar="NODE", help=f"name of a node, package.module:Class, or a type: {types()}")
    for sub in (listing, info):
        add_run_option(sub)
        sub.add_argument("--json", action="store_true", help="print JSON")


def types() -> str:
    """Lists the node types that come with evis, for a help text."""
    from evis.launch import catalog

    return ", ".join(catalog.types())


def run(args: argparse.Namespace) -> int:
    """Runs the action that was named."""
    if args.action == "list":
        return _list(args)
    try:
        plan = find_run(args.run)
    except ValueError:
        if args.run:
            raise
        plan = None
    if plan is not None and args.node in plan.nodes:
        return _running(args, plan)
    return _type(args, plan)


def _list(args: argparse.Namespace) -> int:
    plan = find_run(args.run)
    rows = [
        {"node": n.name, "process": n.process, "target": n.target, "dormant": n.dormant} for n in plan.nodes.values()
    ]
    running = running_graphs()
    if args.json:
        graphs = [{"run": other.run_id, "name": other.name, "mode": other.mode} for other in running]
        print(json.dumps({"run": plan.run_id, "nodes": rows, "running": graphs}))
        return 0
    for other in running:
        this = "  (the nodes below)" if other.run_id == plan.run_id and len(running) > 1 else ""
        print(f"{printable(other.run_id)}  {printable(other.name)}  {other.mode}{this}")
    for row in all_printable(rows):
        print(f"{row['node']:<20} {row['process']:<14} {row['target']}" + ("  (dormant)" if row["dormant"] else ""))
    return 0


def _running(args: argparse.Namespace, plan: Any) -> int:
    node = plan.nodes[args.node]
    state: dict[str, Any] = {}
    for _, message, _ in listen(plan, "/diagnostics", 2.5):
        if message.node == node.name:  # type: ignore[attr-defined]
            state = {"level": message.level, "text": message.text, **message.values}  # type: ignore[attr-defined]
            break
    body = {
        "node": node.name, "process": node.process, "target": node.target, "params": node.params,
        "inputs": node.inputs, "outputs": node.outputs, "dormant": node.dormant, "state": state,
    }  # fmt: skip
    print(json.dumps(body) if args.json else "\n".join(f"{k}: {_shown(v)}" for k, v in all_printable(body).items()))
    return 0


def _shown(value: Any) -> str:
    if isinstance(value, dict):
        return "".join(f"\n  {k}: {v}" for k, v in value.items()) or "none"
    return str(value)


def _type(args: argparse.Namespace, plan: Any) -> int:
    from evis.config.document import LaunchError
    from evis.config.suggestions import nearest
    from evis.launch import catalog

    known = list(dict.fromkeys([*(plan.nodes if plan else ()), *catalog.types()]))
    if args.node not in known and ":" not in args.node:
        raise UsageError(f"no node or node type '{args.node}'; {nearest(args.node, known)}")
    try:
        target, cls = catalog.load(args.node, "")
    except LaunchError as error:
        raise ValueError(str(error).removeprefix(": ")) from None
    params = {
        key: {"type": p.type.__name__, "default": None if p.secret else p.default, "unit": p.unit, "help": p.help}
        for key, p in cls.PARAMS.items()
    }
    inputs = {port: i.topic for port, i in cls.INPUTS.items()}
    outputs = {port: o.topic for port, o in cls.OUTPUTS.items()}
    if args.json:
        print(json.dumps({"type": args.node, "target": target, "params": params, "inputs": inputs, "outputs": outputs}))
        return 0
    inputs, outputs, params = all_printable(inputs), all_printable(outputs), all_printable(params)
    print(f"{printable(args.node)}: {(cls.__doc__ or '').strip().splitlines()[0] if cls.__doc__ else target}")
    for title, ports in (("inputs", inputs), ("outputs", outputs)):
        print(f"{title}: {', '.join(f'{p} {t}' for p, t in ports.items()) or 'none'}")
    print("parameters:")
    for key, param in cls.PARAMS.items():
        print(f"  {key:<16} {describe(param)}")
    return 0
