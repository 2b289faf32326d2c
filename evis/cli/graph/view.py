"""Implements `evis view`, the web visualizer on a running graph, a bag, or a recording of events."""

from __future__ import annotations

import argparse
import json
import os
import secrets
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evis.cli.parser import Parser, UsageError
from evis.console.outlet import delivered
from evis.console.printable import printable

if TYPE_CHECKING:
    from evis.runtime.plan import Plan

HELP = "open the web visualizer on a running graph, a bag, or a recording of events"
EXAMPLE = (
    "Without a file: the page of the running graph; a graph that was started with --no-view gets one.\n"
    "With a file: plays it at its own pace, again and again until Ctrl-C.\n"
    "From another machine: ssh -L 8421:127.0.0.1:8421 HOST, and open the same address.\n"
    "example: evis view disk.mcap"
)
PORT_REMEDY = "--port 0 is any free one"
"""How this command's page gets another port."""


def add_arguments(parser: Parser) -> None:
    """Declares the command's arguments."""
    from evis.cli.graph.attach import add_run_option

    parser.add_argument("file", nargs="?", metavar="BAG|FILE", help="bag (.mcap) or event recording (.raw, .npz, ...)")
    parser.add_argument("--port", type=int, metavar="N", help="port of the page (8421, or the next free one; 0 = any)")
    parser.add_argument("--once", action="store_true", help="play a file once and exit")
    parser.add_argument("--json", action="store_true", help='print {"url": ...} instead of the address alone')
    add_run_option(parser)


def run(args: argparse.Namespace) -> int:
    """Prints the page's address; with a file, or a graph that has no page, serves until Ctrl-C."""
    if args.port is not None and not 0 <= args.port <= 65535:
        raise UsageError(f"--port is {args.port}, it must be 0 to 65535")
    if args.file is not None:
        if args.run:
            raise UsageError("--run is for running graphs, it does not go with a file")
        return _play(args)
    if args.once:
        raise UsageError("--once is for files, it does not go with a running graph")
    from evis.cli.graph.attach import find_run

    plan = find_run(args.run)
    url = page_of(Path(plan.directory))
    if url is not None:
        if args.port:
            raise UsageError(f"--port has no effect: the graph has its page already, {url}")
        _announced(args, url)
        return 0
    return _attach(args, plan)


def page_of(directory: Path) -> str | None:
    """Returns the address of the page that a run's visualizer serves; None when it has none, or no longer."""
    try:
        content = json.loads((directory / "viewer.json").read_text())
        os.kill(int(content["pid"]), 0)
        return str(content["url"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _announced(args: argparse.Namespace, url: str) -> bool:
    """Say the address. False when nobody could be told it: a page without a visitor is not worth serving."""
    print(json.dumps({"url": url}) if args.json else url)
    return delivered()


def _attach(args: argparse.Namespace, plan: Plan) -> int:
    """A visualizer beside a graph that runs without one; it reads by taps and cannot slow the graph."""
    from evis.cli.graph.run import run as run_node
    from evis.web import address
    from nodes.visualizer.socket_lender import SocketLender

    listener, _ = address.bind("127.0.0.1", args.port, PORT_REMEDY)
    token = secrets.token_urlsafe(16)
    lender = SocketLender(listener)
    try:
        if not _announced(args, address.url(listener, token)):  # who comes before the visualizer does waits for it
            return 0
        words = [f"token:={token}", f"listener:={lender.path}"]
        return run_node(
            argparse.Namespace(
                node="visualizer", pairs=words, duration=None, json=False, run=plan.run_id, debug=args.debug
            )
        )
    finally:
        lender.close()


def _play(args: argparse.Namespace) -> int:
    from evis.files.regular import other_than_file
    from evis.web import address
    from nodes.visualizer.socket_lender import SocketLender

    path = Path(args.file)
    if not path.is_file():
        what = other_than_file(path)
        raise FileNotFoundError(f"{path}: {f'it is {what}, and must be a file' if what else 'no such file'}")
    plan = _plan_of(path.resolve())  # a file that cannot be read is told before an address is
    listener, _ = address.bind("127.0.0.1", args.port, PORT_REMEDY)
    token = secrets.token_urlsafe(16)
    lender = SocketLender(listener)
    try:
        if not _announced(args, address.url(listener, token)):
            return 0
        return _serve(args, plan, {"token": token, "listener": lender.path})
    finally:
        lender.close()


def _serve(args: argparse.Namespace, plan: Plan, params: dict[str, Any]) -> int:
    from evis.cli.progress import Progress
    from evis.supervisor.supervisor import Supervisor

    plan.secrets.append(params["token"])
    for node in plan.nodes.values():
        if node.target.endswith(":VisualizerNode"):
            node.params.update(params)
        elif not args.once:
            node.params["again"] = True  # the only other node is the source
    with Progress(None) as progress:
        report = Supervisor(plan, say=progress.say, tick=progress.tick, debug=args.debug).run()
    if report.failure is not None:
        print(f"evis view: {printable(report.failure)}", file=sys.stderr)
        return 1
    return 0


def _is_ours(path: Path) -> bool:
    """Whether a bag has topics of ours to replay; of another recorder's bag the events are played. Raises BagError."""
    from evis.bag.reader import BagReader

    with BagReader(path) as reader:
        return bool(reader.topics)


def _plan_of(path: Path) -> Plan:
    """Plans a graph that plays a file at real pace, with a visualizer. Raises RecordingError for an unknown format."""
    from evis.events import open_recording
    from evis.launch.planner import Options, plan_target

    if path.suffix == ".mcap" and _is_ours(path):
        name, given = "replay", {"bag": str(path), "pace": "realtime"}
    else:
        open_recording(path).close()  # of a format that is known
        name, given = "camera", {"file": str(path), "pace": "realtime"}
    return plan_target(name, given, Options(view=True))
