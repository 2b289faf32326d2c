"""Implements `evis events`, which looks into recordings, converts them, makes events from frames, draws them.

One module per action.
"""

from __future__ import annotations

import argparse
import importlib
import json
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from evis.cli.actions import adder, examples_of
from evis.console.printable import all_printable

HELP = "describe, convert, simulate, measure and draw event recordings"
EXAMPLES = {
    "info": "evis events info recording.raw --json",
    "convert": "evis events convert recording.raw recording.npz",
    "simulate": "evis events simulate frames.npz events.raw --threshold 0.2",
    "measure": "evis events measure recording.raw --json",
    "fit": "evis events fit wheel.aedat4 --scene wheel --out mine.yaml --png fit.png",
    "render": "evis events render recording.raw picture.gif --dt 20 --to 1",
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
    module = _module(args.action)
    with _ended_as_interrupted():
        result: dict[str, Any] = module.run(args)
    if args.json:
        print(json.dumps(result))
        return 0
    result = all_printable(module.for_people(result) if hasattr(module, "for_people") else result)
    width = max(map(len, result))
    for name, value in result.items():
        print(f"{name:{width}}  {_shown(value)}")
    return 0


@contextmanager
def _ended_as_interrupted() -> Iterator[None]:
    """SIGTERM ends as Ctrl-C does: nothing half written is left behind."""
    from evis.cli.events.files import ENDING

    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(number: int, frame: object) -> None:
        ENDING.set()
        raise KeyboardInterrupt(number)

    before = {number: signal.signal(number, interrupt) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        ENDING.clear()


def _shown(value: Any) -> str:
    if isinstance(value, dict):
        parts = [f"{key} {f'{part:.4g}' if isinstance(part, float) else part}" for key, part in value.items()]
        return ", ".join(part.replace(" None", " -") for part in parts)
    shown = "; ".join(map(str, value)) if isinstance(value, list) else str(value)
    return "-" if shown in ("", "None") else shown


def _module(action: str) -> Any:
    return importlib.import_module(f"evis.cli.events.{action}")
