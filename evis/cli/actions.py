"""Declares the actions of a command, such as `info` of `evis bag`: each has an example, with which its help ends."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping

from evis.cli.parser import Parser


def examples_of(examples: Mapping[str, str]) -> str:
    """Lists the examples of all actions, with which the help of the command ends."""
    return "examples:\n" + "\n".join(f"  {example}" for example in examples.values())


def adder(
    parser: argparse.ArgumentParser, examples: Mapping[str, str]
) -> Callable[[str, str], argparse.ArgumentParser]:
    """Makes the function that adds an action to a command by its name and its line of help, and gives its parser.

    examples: action -> a whole command line.
    """
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION", parser_class=Parser)

    def add(name: str, text: str) -> argparse.ArgumentParser:
        return actions.add_parser(name, help=text, description=text, epilog=f"example: {examples[name]}")

    return add
