"""Implements `evis graph`, which draws nodes, processes and topics."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from evis.cli.graph.attach import add_run_option, find_run
from evis.cli.parser import Parser, UsageError
from evis.console.printable import printable_lines
from evis.files.whole_file import missing_folder

HELP = "draw a running graph, or the one that a launch file would make"
EXAMPLE = "example: evis graph spinning_disk --png disk.png"


def add_arguments(parser: Parser) -> None:
    """Declares the command's arguments."""
    parser.add_argument(
        "target", nargs="?", metavar="FILE|NAME", help="launch file or scene; the running graph if not given"
    )
    parser.add_argument("pairs", nargs="*", metavar="key:=value", help="arguments of the launch file or scene")
    parser.add_argument("--png", metavar="OUT", help="draw into this file; otherwise Mermaid text is printed")
    parser.add_argument("--json", action="store_true", help="print the plan as JSON")
    add_run_option(parser)


def run(args: argparse.Namespace) -> int:
    """Prints or draws a graph."""
    from evis.launch.explain import as_dict

    if args.png:
        out = Path(args.png)
        if out.suffix.lower() != ".png":
            raise UsageError(f"{out}: --png writes a .png file")
        if missing := missing_folder(out):
            raise ValueError(missing)
    if args.run and args.target is not None:
        raise UsageError("--run is for running graphs, it does not go with a launch file or scene")
    plan = find_run(args.run) if args.target is None else _planned(args)
    if args.png:
        from evis.cli.graph.drawing import draw

        draw(plan, out)
    if args.json:
        print(json.dumps(as_dict(plan)))
    elif not args.png:
        print(printable_lines(mermaid(plan)))
    return 0


def _planned(args: argparse.Namespace) -> Any:
    from evis.launch.arguments import ArgumentError, parse_pairs
    from evis.launch.planner import Options, plan_target

    try:
        return plan_target(args.target, parse_pairs(args.pairs), Options())
    except ArgumentError as error:
        raise UsageError(str(error)) from None


def mermaid(plan: Any) -> str:
    """Writes the graph in Mermaid's flowchart language: processes as boxes, dashed arrows for taps."""
    names = {name: f"n{index}" for index, name in enumerate(plan.nodes)}
    groups: dict[str, list[Any]] = {}
    for node in plan.nodes.values():
        groups.setdefault(node.process, []).append(node)
    lines = ["flowchart LR"]
    for index, (process, nodes) in enumerate(groups.items()):
        lines.append(f'  subgraph p{index}["{process}"]')
        for node in nodes:
            late = " (dormant)" if node.dormant else ""
            lines.append(f'    {names[node.name]}["{node.name}{late}"]')
        lines.append("  end")
    for topic in plan.topics.values():
        for edge in topic.edges:
            arrow = "-->" if edge.kind == "lockstep" else "-.->"
            lines.append(f'  {names[topic.node]} {arrow}|"{topic.name}"| {names[edge.node]}')
    return "\n".join(lines)
