"""Implements `evis topic`, which shows what is published in a running graph.

What reads attaches by taps, which can slow nobody.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from typing import Any

from evis.cli.actions import adder
from evis.cli.graph.attach import add_run_option, find_run, listen
from evis.cli.graph.publish import add_pub_arguments, count, run_pub
from evis.cli.numbers import number_up_to
from evis.cli.parser import Parser
from evis.client.running import check_topic, lives
from evis.console.printable import all_printable

_SECONDS = number_up_to(1e9, "is no time in seconds above 0")
HELP = "list, echo, measure and publish the topics of a running graph"
EXAMPLE = "example: evis topic hz /cam0/events"

ACTIONS = {
    "list": "names and types",
    "info": "type, publisher and readers of one topic",
    "echo": "print messages as they come",
    "hz": "messages per second, counted by sequence number",
    "bw": "bytes per second",
    "delay": "how far messages lag behind their stamps",
    "pub": "give a message to the graph from outside: /action (the controller that it has not), /reset",
}
_OTHER_WORDS = {"list": "--json", "pub": "/action 0.5 -0.3 0.8 0 0.2 0"}
EXAMPLES = {name: f"evis topic {name} {_OTHER_WORDS.get(name, '/cam0/events')}" for name in ACTIONS}


def add_arguments(parser: Parser) -> None:
    """Declares the command's arguments."""
    add = adder(parser, EXAMPLES)
    for name, text in ACTIONS.items():
        sub = add(name, text)
        if name != "list":
            sub.add_argument("topic", metavar="TOPIC", help="as `evis topic list` names it")
        if name == "pub":
            add_pub_arguments(sub)
        if name in ("hz", "bw", "delay"):
            sub.add_argument(
                "--window", type=_SECONDS, default=3.0, metavar="S", help="measure for so many seconds (3)"
            )
        if name == "echo":
            sub.add_argument("-n", "--count", type=count, default=0, help="stop after so many messages (0: go on)")
            sub.add_argument("--timeout", type=_SECONDS, default=None, metavar="S", help="stop after so many seconds")
            sub.add_argument("--full", action="store_true", help="print whole arrays, not only shape and range")
        add_run_option(sub)
        sub.add_argument("--json", action="store_true", help="print JSON")


def run(args: argparse.Namespace) -> int:
    """Runs one action on a running graph."""
    if args.action == "pub":
        return run_pub(args)
    plan = find_run(args.run)
    if args.action == "list":
        return _list(args, plan)
    check_topic(plan, args.topic)
    actions: dict[str, Callable[[argparse.Namespace, Any], int]] = {
        "info": _info, "echo": _echo, "hz": _measure, "bw": _measure, "delay": _measure,
    }  # fmt: skip
    return actions[args.action](args, plan)


def _list(args: argparse.Namespace, plan: Any) -> int:
    from msgs.topics import SYSTEM_TOPICS, find_topic

    rows = {name: plan.topics[name].type for name in plan.open_topics()}
    rows |= {name: find_topic(name).type.__name__ for name in SYSTEM_TOPICS}
    if args.json:
        print(json.dumps({"run": plan.run_id, "topics": rows}))
    else:
        rows = all_printable(rows)
        width = max(map(len, rows))
        for name, kind in sorted(rows.items()):
            print(f"{name:<{width}}  {kind}")
    return 0


def _info(args: argparse.Namespace, plan: Any) -> int:
    from msgs.topics import find_topic

    row = find_topic(args.topic)
    topic = plan.topics.get(args.topic)
    body = {
        "topic": args.topic,
        "type": row.type.__name__,
        "about": row.help,
        "publisher": topic.node if topic else "every process",
        "readers": [{"node": e.node, "port": e.port, "kind": e.kind} for e in topic.edges] if topic else [],
        "taps": _taps(args.topic, plan),
        "latched": row.latched,
        "recorded": row.recorded,
    }
    if args.json:
        print(json.dumps(body))
        return 0
    body = all_printable(body)
    readers = ", ".join(f"{r['node']} ({r['kind']})" for r in body["readers"]) or "none; viewers and tools may tap it"
    print(f"{body['topic']}: {body['type']}, {body['about']}\npublisher: {body['publisher']}\nreaders: {readers}")
    print(f"taps: {', '.join(body['taps'])}")
    return 0


def _taps(topic: str, plan: Any) -> list[str]:
    """Addresses at which ZeroMQ gives the lossy copy of a topic: one, or of a system topic that of each process."""
    from evis.bus import endpoints_for
    from evis.runtime.hosting.wiring import system_topic
    from msgs.topics import SYSTEM_TOPICS

    names = [system_topic(topic, process) for process in sorted({n.process for n in plan.nodes.values()})]
    return [endpoints_for(plan.directory, name).tap for name in (names if topic in SYSTEM_TOPICS else [topic])]


def _echo(args: argparse.Namespace, plan: Any) -> int:
    from evis.cli.graph.show import as_plain, as_text
    from evis.console.outlet import strict_output

    shown = 0
    try:
        for _, message, _ in listen(plan, args.topic, args.timeout):
            with strict_output():
                print(json.dumps(as_plain(message, args.full)) if args.json else as_text(message, args.full))
            shown += 1
            if args.count and shown >= args.count:
                break
    except KeyboardInterrupt:
        pass
    if not shown:
        when = f"in {args.timeout:g} s" if args.timeout and lives(plan) else "before the graph ended"
        raise ValueError(f"{args.topic}: no message came {when}")
    return 0


def _measure(args: argparse.Namespace, plan: Any) -> int:
    from evis.cli.graph.topic_rates import TopicRates

    measure = TopicRates()
    try:
        for arrived, message, sender in listen(plan, args.topic, args.window):
            measure.add(arrived, message, sender)
    except KeyboardInterrupt:
        pass
    if measure.messages < 2:
        raise ValueError(f"{args.topic}: {measure.messages} message(s) in {args.window:g} s, too few to measure")
    body = {"topic": args.topic, **getattr(measure, args.action)()}
    print(
        json.dumps(body)
        if args.json
        else ", ".join(f"{k} {v:.6g}" if isinstance(v, float) else f"{k} {v}" for k, v in all_printable(body).items())
    )
    return 0
