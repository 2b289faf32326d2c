"""Implements `evis dataset`, which makes labelled sequences from a recipe, describes, checks and shows them.

One module per action.
"""

from __future__ import annotations

import argparse
import importlib
from typing import Any

from evis.cli.actions import adder, examples_of

HELP = "make data sets from a recipe, describe, check and show them"
EXAMPLES = {
    "make": "evis dataset make rotation --count 20 --out disks",
    "info": "evis dataset info disks --json",
    "verify": "evis dataset verify disks",
    "show": "evis dataset show disks",
}
EXAMPLE = examples_of(EXAMPLES)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    add = adder(parser, EXAMPLES)
    for name in EXAMPLES:
        module = _module(name)
        action = add(name, module.HELP)
        module.add_arguments(action)
        action.add_argument("--json", action="store_true", help="print JSON")


def run(args: argparse.Namespace) -> int:
    """Runs one action. Raises ValueError or OSError with one line for a person."""
    return int(_module(args.action).run(args))


def _module(action: str) -> Any:
    return importlib.import_module(f"evis.cli.dataset.{action}")
