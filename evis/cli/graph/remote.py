"""Implements `evis remote`, which brings topics of a running graph to another host."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evis.cli.actions import adder, examples_of
from evis.cli.graph.attach import add_run_option, find_run
from evis.cli.parser import UsageError
from evis.console.printable import printable

if TYPE_CHECKING:
    from evis.remote.follower import Follower

HELP = "bring topics of a running graph to another host"
EXAMPLES = {
    "keys": "evis remote keys lab",
    "serve": "evis remote serve tcp://0.0.0.0:7447 --key lab.key_secret --allow desk.key",
    "follow": "evis remote follow tcp://192.168.1.5:7447 --key desk.key_secret --server lab.key",
}
EXAMPLE = examples_of(EXAMPLES)
MAKES = "`evis remote keys NAME` makes a pair"
MOST_ASKED = 3
"""Ctrl-C and SIGTERM end it in order; one more ends a close that hangs."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    action = adder(parser, EXAMPLES)
    keys = action("keys", "make a key pair: NAME.key for the other host, NAME.key_secret for this one alone")
    keys.add_argument("name", metavar="NAME", help="of the two files, without ending")

    serve = action(
        "serve", "offer topics of the graph that runs here to hosts whose keys are known; they can slow nobody"
    )
    serve.add_argument("address", metavar="tcp://ADDRESS:PORT", help="of this host; * = any (tcp://*:7447)")
    serve.add_argument("--key", metavar="FILE", help="secret key of this host, NAME.key_secret")
    serve.add_argument(
        "--allow", action="append", default=[], metavar="FILE", help="public key of a host that may follow; repeatable"
    )
    serve.add_argument("--topics", default="", metavar="GLOB,...", help="topics besides those of `evis bag record`")
    add_run_option(serve)

    follow = action("follow", "make topics of a graph on another host topics of a run here, until it ends or Ctrl-C")
    follow.add_argument("address", metavar="tcp://HOST:PORT", help="where `evis remote serve` runs")
    follow.add_argument("--key", metavar="FILE", help="secret key of this host, NAME.key_secret")
    follow.add_argument("--server", metavar="FILE", help="public key of the other host, NAME.key")
    for sub in (keys, serve, follow):
        sub.add_argument("--json", action="store_true", help="print JSON, a line at the start and one at the end")


def run(args: argparse.Namespace) -> int:
    """Runs one action. Raises ValueError or OSError with one line for a person."""
    actions: dict[str, Callable[[argparse.Namespace], None]] = {"keys": _keys, "serve": _serve, "follow": _follow}
    actions[args.action](args)
    return 0


def _keys(args: argparse.Namespace) -> None:
    from evis.files.whole_file import missing_folder
    from evis.remote.keys import make_pair

    if not Path(args.name).name or args.name.endswith("/"):
        raise UsageError(f"'{args.name}' is no name of files")
    if missing := missing_folder(args.name):
        raise ValueError(missing)
    public, secret = make_pair(args.name)
    _print(args, {"public": str(public), "secret": str(secret)})


def _serve(args: argparse.Namespace) -> None:
    from evis.bag.selection import select, unmatched, unpublished
    from evis.remote.keys import read_pair, read_public
    from evis.remote.offer import offered
    from evis.remote.server import Server
    from evis.supervisor.interrupts import Interrupts
    from evis.supervisor.run_directory import is_live

    address = _address(args.address, bound=True)
    if not args.key or not args.allow:
        missing = "--key FILE, this host's secret key" if not args.key else "--allow FILE, a follower's public key"
        raise UsageError(f"topics are offered over a network under keys only, so give {missing}; {MAKES}")
    key = read_pair(Path(args.key))
    allowed = {read_public(Path(path)): path for path in args.allow}
    plan = find_run(args.run)
    globs = [glob.strip() for glob in args.topics.split(",") if glob.strip()]
    names = plan.open_topics()
    if wrong := unmatched(names, globs):
        raise UsageError(f"no topic is like '{wrong[0]}'; the graph has {', '.join(sorted(names))}")
    for glob in unpublished(names, globs):
        _say(f"no node of this graph publishes a topic like '{glob}'")
    topics = select(names, globs)
    asked = Interrupts(most=MOST_ASKED)
    with asked.counted():
        server = Server(offered(plan, topics), address, key, allowed)
        try:
            _print(args, {"address": server.address, "run": plan.run_id, "topics": topics})
            server.run(lambda: not asked.count and is_live(Path(plan.directory)), _say)
            if not asked.count:
                server.end()
        finally:
            server.close()
    _print(args, dict(server.counters))


def _follow(args: argparse.Namespace) -> None:
    from evis.remote.follower import Follower
    from evis.remote.keys import read_pair, read_public
    from evis.supervisor.interrupts import Interrupts

    address = _address(args.address, bound=False)
    if not args.key or not args.server:
        missing = "--key FILE, this host's secret key" if not args.key else "--server FILE, the other host's public key"
        raise UsageError(f"topics are read over a network under keys only, so give {missing}; {MAKES}")
    asked = Interrupts(most=MOST_ASKED)
    follower = Follower(address, read_pair(Path(args.key)), read_public(Path(args.server)), _say)
    with asked.counted():
        try:
            if not follower.connect(lambda: asked.count > 0):
                raise KeyboardInterrupt
            _announce(args, follower)
            shown = follower.run
            while not asked.count and not follower.ended:
                follower.follow()
                if follower.run is not shown:
                    shown = follower.run
                    _announce(args, follower)
        finally:
            follower.close()
    _print(args, dict(follower.counters))
    if not args.json and follower.counters["lost"]:
        _say("what was lost on the way has gaps in its sequence numbers here")


def _announce(args: argparse.Namespace, follower: Follower) -> None:
    if follower.run is not None:
        plan = follower.run.plan
        _print(args, {"run": plan.run_id, "name": plan.name, "topics": plan.open_topics()})


def _address(text: str, bound: bool) -> str:
    from evis.remote.protocol import check_address

    try:
        return check_address(text, bound)
    except ValueError as error:
        raise UsageError(str(error)) from None


def _say(line: str) -> None:
    print(f"evis remote: {printable(line)}", file=sys.stderr, flush=True)


def _print(args: argparse.Namespace, body: dict[str, Any]) -> None:
    """Prints at once, for whoever waits for it."""
    if args.json:
        print(json.dumps(body), flush=True)
        return
    for name, value in body.items():
        print(f"{name}: {printable(', '.join(value) if isinstance(value, list) else str(value))}", flush=True)
