"""Implements `evis dataset verify`, which checks whether a data set is whole."""

from __future__ import annotations

import argparse
import json
import sys

from evis.console.printable import printable

HELP = "recompute every checksum of a data set, and read every sequence"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the action's arguments."""
    parser.add_argument("dataset", metavar="DIR", help="folder of a data set, or s3://... (evis[cluster])")


def run(args: argparse.Namespace) -> int:
    """Verifies a data set and prints what is wrong; returns 1 where something is."""
    from evis.dataset.report.verify import verify

    found = verify(args.dataset)
    if args.json:
        print(json.dumps(found))
    else:
        words = f"{found['sequences']} sequences, {found['files']} files, {found['events']:,} events"
        failed = f"; {len(found['failed'])} could not be made" if found["failed"] else ""
        print(printable(f"{args.dataset}: {words}{failed}" + ("" if found["wrong"] else ", all as they were written")))
        for line in found["wrong"]:
            print(printable(f"  {line}"))
    if found["wrong"]:
        count = len(found["wrong"])
        remedy = "remove those sequences, and `evis dataset make ... --resume` makes them again"
        print(f"evis dataset: {count} thing{'s' if count > 1 else ''} wrong; {remedy}", file=sys.stderr)
    return 1 if found["wrong"] else 0
