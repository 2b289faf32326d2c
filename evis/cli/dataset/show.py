"""Implements `evis dataset show`, which makes a contact sheet and a page of a data set."""

from __future__ import annotations

import argparse
import json

from evis.cli.parser import UsageError
from evis.console.printable import printable

HELP = "draw frame, events and labels of each sequence: a contact sheet (PNG) and a page (HTML)"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the action's arguments."""
    parser.add_argument("dataset", metavar="DIR", help="folder of a data set, or s3://... (evis[cluster])")
    parser.add_argument("--out", metavar="PREFIX", help="PREFIX.png and PREFIX.html; not given, DIR/contact_sheet")
    parser.add_argument("--most", type=int, default=48, metavar="N", help="sequences on it, spread over all (48)")


def run(args: argparse.Namespace) -> int:
    """Draws the contact sheet, and prints where it is."""
    if args.most < 1:
        raise UsageError(f"--most is {args.most}; the least is 1")
    from evis.dataset.report.sheet import write_sheet

    files = write_sheet(args.dataset, args.out, args.most)
    print(json.dumps({"files": files}) if args.json else "\n".join(map(printable, files)))
    return 0
