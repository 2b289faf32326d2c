"""Implements `evis camera set`, which changes settings of a camera that streams in a running graph."""

from __future__ import annotations

import argparse
import json

from evis.cli.graph.attach import add_run_option, find_run
from evis.cli.parser import UsageError


def add_set_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the arguments of `evis camera set`."""
    parser.add_argument(
        "settings", nargs="+", metavar="NAME=VALUE",
        help="settings as `evis camera info --settings` lists them; all are written, or none where one is refused",
    )  # fmt: skip
    parser.add_argument("--camera", metavar="CAM", help="name in the topics, of several cameras (the only one)")
    add_run_option(parser)


def run_set(args: argparse.Namespace) -> int:
    """Sends the settings to the camera, and says after which of its packets they were written."""
    from evis.client.run import Run

    values = _values(args.settings)
    plan = find_run(args.run)
    with Run(plan) as running:
        after_ns = running.set_camera(args.camera, **values)
    if args.json:
        print(json.dumps({"run": plan.run_id, "settings": values, "after_ns": after_ns}))
    else:
        print(f"{plan.name}: {', '.join(args.settings)} set after the packet of {after_ns / 1e9:.6f} s")
    return 0


def _values(texts: list[str]) -> dict[str, str]:
    """Reads NAME=VALUE texts. Raises UsageError for one that is none, and for a name that comes twice."""
    values: dict[str, str] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name:
            raise UsageError(f"a setting is given as NAME=VALUE, not '{text}'")
        if name in values:
            raise UsageError(f"{name} is given twice; which one is meant?")
        values[name] = value
    return values
