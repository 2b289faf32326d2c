"""Implements `evis run`, which runs one node by hand, as a graph of its own or attached to a running one."""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

from evis.cli.graph.attach import add_run_option, find_run
from evis.cli.graph.node import types
from evis.cli.parser import Parser, UsageError, check_duration
from evis.console.printable import printable, printable_lines

HELP = "run one node by hand"
EXAMPLE = (
    "A source runs by itself. A node with inputs attaches to a running graph, by taps, and cannot slow it.\n"
    "example: evis run camera file:=recording.raw\n"
    "example: evis run recorder path:=part.mcap topics:=/cam0/events"
)
INTERMIXED = True


def add_arguments(parser: Parser) -> None:
    """Declares the command's arguments."""
    parser.add_argument("node", metavar="NODE", help=f"package.module:Class, or a type: {types()}")
    parser.add_argument("pairs", nargs="*", metavar="key:=value", help="parameters; `evis node info NODE` lists them")
    parser.add_argument("--duration", type=float, metavar="S", help="stop after so many seconds")
    parser.add_argument("--json", action="store_true", help="print the summary as JSON")
    add_run_option(parser)


def run(args: argparse.Namespace) -> int:
    """Runs one node by itself, or attached to a running graph."""
    from evis.config.document import LaunchError
    from evis.config.params import ParamError
    from evis.launch.arguments import ArgumentError, parse_pairs
    from evis.launch.catalog import load
    from evis.launch.expand import NodeSpec
    from evis.launch.unused_arguments import check_parameters

    check_duration(args.duration)
    try:
        params = parse_pairs(args.pairs)
    except ArgumentError as error:
        raise UsageError(str(error)) from None
    sys.path.append(os.getcwd())  # a node of the user's own
    try:
        _, cls = load(args.node, "evis run")
    except LaunchError as error:
        raise UsageError(str(error).removeprefix("evis run: ")) from None
    try:
        if args.duration is not None and "duration" in cls.PARAMS:
            params.setdefault("duration", str(args.duration))
        check_parameters(cls, args.node, params)
        name = args.node.rpartition(":")[2].lower()
        spec = NodeSpec(name=name, type=args.node, where="evis run", params=dict(params), process=name)
        # A source that has no such parameter would never end by itself.
        stop_after_s = None if "duration" in cls.PARAMS else args.duration
        summary = _alone(spec, args, stop_after_s) if cls.SOURCE else _attached(spec, args)
    except (ArgumentError, ParamError) as error:
        raise UsageError(str(error).removeprefix("evis run: ")) from None
    except LaunchError as error:
        raise ValueError(str(error).removeprefix("evis run: ")) from None
    if args.json:
        print(json.dumps(summary))
    return 1 if summary.get("error") else 0


def _alone(spec: Any, args: argparse.Namespace, stop_after_s: float | None) -> dict[str, Any]:
    """A graph of one source; others may look at it with `evis topic`. stop_after_s: on the wall clock [s]."""

    from evis.cli.progress import Progress
    from evis.launch.expand import Expanded
    from evis.launch.graph.wiring import wire
    from evis.launch.planner import Options, plan_nodes
    from evis.supervisor.report import as_table
    from evis.supervisor.supervisor import Supervisor

    spec.keep = list(wire(spec, Path.cwd()).outputs)
    expanded = Expanded(spec.name, f"{spec.type} by hand", "live", {}, [spec])
    plan = plan_nodes(expanded, Path.cwd(), Options(duration_s=args.duration))
    with Progress(args.duration) as progress:
        supervisor = Supervisor(plan, say=progress.say, tick=progress.tick, debug=args.debug, stop_after_s=stop_after_s)
        report = supervisor.run()
    if report.failure:
        print(f"evis run: {printable(report.failure)}", file=sys.stderr)
    elif not args.json:
        print(printable_lines(as_table(report)))
    return report.summary


def _attached(spec: Any, args: argparse.Namespace) -> dict[str, Any]:
    """In this process, reading a running graph by taps until that ends, --duration is over, or Ctrl-C."""

    from evis.launch.attach import attach
    from evis.runtime.executor import Executor
    from evis.runtime.process.control import ask_for
    from evis.supervisor.run_directory import is_live

    plan = find_run(args.run)
    spec.name = spec.process = f"{spec.name}.{os.getpid()}"
    attach(plan, spec, Path.cwd())
    published = list(plan.nodes[spec.name].outputs.values())
    for topic in published:
        print(f"evis run: warning: {_unread(plan, spec.type, topic)}", file=sys.stderr)
    executor = Executor(plan, spec.process, request=lambda topic: ask_for(plan.directory, topic))
    end = None if args.duration is None else time.monotonic() + args.duration
    heard: set[str] = set()

    def commands() -> None:
        heard.update(executor.topics_read())
        if (end is not None and time.monotonic() > end) or not is_live(Path(plan.directory)):
            executor.stop()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: executor.stop())
    try:
        try:
            executor.setup()
        except Exception:
            if is_live(Path(plan.directory)):
                raise
            raise ValueError(f"the graph {plan.run_id} ended before {spec.type} was ready") from None
        executor.wait_connected(10.0, commands)
        executor.run(commands)
        summary: dict[str, Any] = {"nodes": executor.summary()}
        if published and not heard:
            summary["error"] = f"nobody read what {spec.type} published on {', '.join(published)}"
            print(f"evis run: {summary['error']}", file=sys.stderr)
        return summary
    finally:
        executor.close()


def _unread(plan: Any, node: str, topic: str) -> str:
    """Why what an attached node publishes reaches nobody in the graph, and what to do."""
    from evis.config.suggestions import nearest
    from evis.launch.graph.left_out import untaken

    taken = untaken(plan)
    if topic in taken:
        why = (
            f"{taken[topic]} takes it only in a graph that was started with a node that publishes it, or of a program "
        )
        why += "that asks for it by evis.connect()"
    elif taken:
        near = nearest(topic, taken)
        why = f"it would take {', '.join(taken)}" + (f" ({near})" if near.startswith("did") else "")
    else:
        why = "it takes no topic from outside"
    return f"nobody in the running graph reads {topic} of {node}; {why}; put both in one launch file (`include:`)"
