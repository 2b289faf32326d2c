"""Implements `evis dataset`, which makes labelled sequences from a recipe, describes, checks and shows them.

One module per action.
"""

from __future__ import annotations

import argparse
import importlib
from typing import Any

from evis.cli.parser import Parser

HELP = "make data sets from a recipe, describe, check and show them"
EXAMPLES = {
    "make": "evis dataset make rotation --count 20 --out disks",
    "info": "evis dataset info disks --json",
    "verify": "evis dataset verify disks",
    "show": "evis dataset show disks",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = "examples:\n" + "\n".join(f"  {example}" for example in EXAMPLES.values())
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION", parser_class=Parser)
    for name, example in EXAMPLES.items():
        module = _module(name)
        action = actions.add_parser(name, help=module.HELP, description=module.HELP, epilog=f"example: {example}")
        module.add_arguments(action)
        action.add_argument("--json", action="store_true", help="print JSON")


def run(args: argparse.Namespace) -> int:
    """Runs one action. Raises ValueError or OSError with one line for a person."""
    return int(_module(args.action).run(args))


def _module(action: str) -> Any:
    return importlib.import_module(f"evis.cli.dataset.{action}")
