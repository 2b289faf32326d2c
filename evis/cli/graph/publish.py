"""Implements `evis topic pub`, which gives a message to a running graph from the command line, once or at a rate."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from evis.cli.graph.attach import find_run
from evis.cli.numbers import number_up_to
from evis.cli.parser import UsageError
from evis.files.json_text import parsed

_RATE = number_up_to(10_000, "is no rate in Hz above 0, up to 10000")


def add_pub_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the arguments of `evis topic pub` beside the topic."""
    parser.add_argument(
        "values", nargs="*", metavar="VALUE",
        help='controls, one per actuator, or the message as JSON: \'[0.1, 0]\', \'{"controls": [[0.1, 0]]}\'',
    )  # fmt: skip
    parser.add_argument(
        "--rate",
        type=_RATE,
        metavar="HZ",
        help="again and again at this rate, until Ctrl-C",
    )
    parser.add_argument(
        "-n", "--count", type=count, default=0, help="with --rate, stop after so many messages (0: go on)"
    )


def count(text: str) -> int:
    """Reads a number of messages, 0 or more. Raises ArgumentTypeError."""
    if not (text.isdecimal() and text.isascii()):
        raise argparse.ArgumentTypeError(f"'{text}' is no number of messages, 0 or more")
    return int(text)


def run_pub(args: argparse.Namespace) -> int:
    """Publishes, and says what was taken."""
    from evis.client.requests import ACTION, RESET, taker
    from evis.client.run import Run

    body = message_of(args.values)
    _check_message(args, body)
    plan = find_run(args.run)
    taker(plan, args.topic)  # a topic that nobody reads is told before anything is sent
    sent, stamp = 0, 0
    try:
        with Run(plan) as running:
            if args.topic == RESET:
                sent, stamp = 1, running.reset(body.get("seeds"), body.get("envs"))
            elif args.topic == ACTION:
                running.take(lockstep=False)
                for stamp in _actions(args, running, body):  # noqa: B007 - both are told at the end
                    sent += 1
            else:
                raise ValueError(
                    f"evis topic pub knows {ACTION} and {RESET}, and not {args.topic}; "
                    "`evis camera set NAME=VALUE` changes settings of a camera"
                )
    except KeyboardInterrupt:
        pass
    if args.json:
        print(json.dumps({"run": plan.run_id, "topic": args.topic, "sent": sent, "stamp_ns": stamp}))
    else:
        print(f"{plan.name}: {sent} message(s) on {args.topic}, the last from {stamp / 1e9:.6g} s on")
    return 0


def _check_message(args: argparse.Namespace, body: dict[str, Any]) -> None:
    """Refuses what the message of a topic has no place for: without it, it would mean something else."""
    from evis.client.requests import ACTION, RESET

    fields = {ACTION: ["controls"], RESET: ["envs", "seeds"]}.get(args.topic, list(body))
    if strange := [name for name in body if name not in fields]:
        raise UsageError(f"{args.topic} takes {' and '.join(f'`{name}`' for name in fields)}, and not `{strange[0]}`")
    if args.topic == ACTION and not body:
        raise UsageError("an action has `controls`, and not nothing")
    if args.topic == RESET and (args.rate or args.count):
        raise UsageError(f"--rate and --count are for {ACTION}; a reset is given once")
    if args.count and not args.rate:
        raise UsageError("--count says how many messages to send at --rate HZ; give that too")


def _actions(args: argparse.Namespace, running: Any, body: dict[str, Any]) -> Iterator[int]:
    """Give the action as often as asked for; yields the stamp from which on each holds."""
    total = args.count or (0 if args.rate else 1)
    start, sent = time.monotonic(), 0
    while True:
        yield running.act(body["controls"])
        sent += 1
        if sent == total:
            return
        time.sleep(max(0.0, start + sent / args.rate - time.monotonic()))


def message_of(words: list[str]) -> dict[str, Any]:
    """Reads the fields of a message: numbers are controls, `[...]` too, `{...}` is the message. Raises UsageError."""
    text = " ".join(words).strip()
    if not text.startswith(("[", "{")):
        try:
            return {"controls": [float(word) for word in words]} if words else {}
        except ValueError as error:
            raise UsageError(f"values are numbers or JSON: {error}") from None
    try:
        body = parsed(text)
    except ValueError as error:
        raise UsageError(f"'{text:.80}' is no JSON: {error}") from None
    if isinstance(body, list):
        body = {"controls": body}
    for name, value in body.items():
        try:
            np.asarray(value, np.float64)
        except (TypeError, ValueError):
            raise UsageError(f"`{name}` must be numbers, and not {value!r:.80}") from None
    return body
