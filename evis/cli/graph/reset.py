"""Implements `evis reset`, which begins the environments of a running simulation anew."""

from __future__ import annotations

import argparse
import json

from evis.cli.graph.attach import add_run_option, find_run
from evis.cli.parser import Parser, UsageError

HELP = "begin a running simulation anew, or some of its environments"
EXAMPLE = "example: evis reset --envs 0,3 --seed 7"


def add_arguments(parser: Parser) -> None:
    """Declares the command's arguments."""
    parser.add_argument("--envs", metavar="LIST", help="environments, as 0,3; all if not given")
    parser.add_argument(
        "--seed",
        type=int,
        metavar="N",
        help="seed of the first, the others have the next ones; kept if not given",
    )
    add_run_option(parser)
    parser.add_argument("--json", action="store_true", help="print JSON")


def run(args: argparse.Namespace) -> int:
    """Asks physics for a reset, and prints the time from which on the environments begin anew."""
    from evis.client.run import Run

    envs = None if args.envs is None else _numbers(args.envs)
    if args.seed is not None and args.seed < 0:
        raise UsageError(f"--seed is {args.seed}, it must be 0 or more")
    plan = find_run(args.run)
    with Run(plan) as running:
        after_ns = running.reset(args.seed, envs)
    if args.json:
        print(json.dumps({"run": plan.run_id, "after_ns": after_ns, "envs": envs, "seed": args.seed}))
    else:
        what = "all environments begin" if envs is None else f"environment(s) {args.envs} begin"
        print(f"{plan.name}: {what} anew at the first keyframe after {after_ns / 1e9:.6g} s")
    return 0


def _numbers(text: str) -> list[int]:
    try:
        return [int(word) for word in text.split(",")]
    except ValueError:
        raise UsageError(f"--envs is '{text}', it must be numbers of environments, as 0,3") from None
