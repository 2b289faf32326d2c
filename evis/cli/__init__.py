"""Implements the program `evis`: one module per command, imported when its command is used.

A command's module has HELP (one line), EXAMPLE, `add_arguments(parser)` and `run(args) -> exit status`. They lie in
rooms by what they are about: `graph/`, `events/`, `machine/`.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence
from types import ModuleType

from evis.console import interrupt, working_folder

COMMANDS = {
    "launch": ("graph.launch", "start a graph of nodes"),
    "run": ("graph.run", "run one node by hand"),
    "topic": ("graph.topic", "list, echo, measure and publish the topics of a running graph"),
    "reset": ("graph.reset", "begin a running simulation anew"),
    "node": ("graph.node", "list and describe the nodes of a running graph"),
    "graph": ("graph.graph", "draw a running graph"),
    "doctor": ("machine.doctor", "check this machine and this installation"),
    "bag": ("graph.bag", "record, play, describe, repair and export bags"),
    "events": ("events", "describe, convert, simulate, measure and draw event recordings"),
    "dataset": ("dataset", "make data sets from a recipe, describe, check and show them"),
    "remote": ("graph.remote", "bring topics of a running graph to another host"),
    "camera": ("machine.camera", "find and try USB event cameras"),
    "view": ("graph.view", "open the web visualizer"),
    "bench": ("machine.bench", "measure error against run time, stability, throughput"),
}
"""Name -> module below evis.cli, and one line for `evis --help`, so that it need not import them."""

HELP = ("-h", "--help", "help")
"""Words that ask for help: before a command's name for its own."""

STATUSES = (
    "exit status: 0 success, 1 failure, 2 wrong usage, 130 interrupted by Ctrl-C, 143 by SIGTERM (a graph whose\n"
    "processes have been started, `bag record` and `remote` end in order, with 0), 141 the work is done but who was\n"
    "to read standard output had gone before all was said (to `topic echo` and `camera stream` that is the end, and 0)."
)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command and gives its exit status, as STATUSES says; a failure is told in one line on stderr."""
    from evis.cli.failure import guarded

    interrupt.begin()
    words = list(sys.argv[1:] if argv is None else argv)
    debug = "--debug" in words
    words = [word for word in words if word != "--debug"]
    who = f"evis {words[0]}" if words and words[0] in COMMANDS else "evis"
    status = guarded(who, debug, lambda: _command(words, debug))
    interrupt.no_more()
    return status


def module_of(command: str) -> ModuleType:
    """Imports the module of a command of COMMANDS."""
    return importlib.import_module(f"evis.cli.{COMMANDS[command][0]}")


def _command(words: list[str], debug: bool) -> int:
    if len(words) > 1 and words[0] in HELP:
        words = [*words[1:], "--help"]  # `evis help launch`, as `evis launch --help`
    if not words or words[0] in HELP:
        print(_overview(), file=sys.stdout if words else sys.stderr)
        return 0 if words else 2
    if words[0] in ("-V", "--version"):
        from importlib.metadata import version

        print(f"evis {version('evis')}")
        return 0
    command, rest = words[0], words[1:]
    if working_folder.is_removed():  # what needs it later, Python itself too, would not say what is missing
        print(f"evis: {working_folder.REMOVED}", file=sys.stderr)
        return 1
    if command in COMMANDS:
        return _run(command, rest, debug)
    from evis.config.suggestions import nearest

    print(f"evis: no command '{command}'; {nearest(command, COMMANDS)}", file=sys.stderr)
    return 2


def _run(command: str, words: list[str], debug: bool) -> int:
    from evis.cli.parser import Parser

    module = module_of(command)
    parser = Parser(f"evis {command}", module.HELP, getattr(module, "EXAMPLE", ""), words)
    module.add_arguments(parser)
    # Words such as key:=value may stand between options; argparse only takes that in this mode.
    parse = parser.parse_intermixed_args if getattr(module, "INTERMIXED", False) else parser.parse_args
    args = parse(words)
    args.debug = debug
    return int(module.run(args) or 0)


def _overview() -> str:
    lines = ["usage: evis COMMAND ...", "", "Event-camera simulation for robots, as a graph of processes.", ""]
    lines += [f"  {name:<9} {text}" for name, (_, text) in COMMANDS.items()]
    lines += [
        "",
        "`evis COMMAND --help` (or `evis help COMMAND`) tells more.",
        "--debug shows tracebacks and every line that the processes write.",
        STATUSES,
        "example: evis launch spinning_disk --duration 1",
    ]
    return "\n".join(lines)
