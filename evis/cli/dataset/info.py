"""Implements `evis dataset info`, which describes what a data set holds."""

from __future__ import annotations

import argparse
import json

from evis.console.printable import printable

HELP = "describe a data set: counts, rates, splits"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the action's arguments."""
    parser.add_argument("dataset", metavar="DIR", help="folder of a data set, or s3://... (evis[cluster])")


def run(args: argparse.Namespace) -> int:
    """Prints a summary of the data set."""
    from evis.dataset.report.summary import summary

    told = summary(args.dataset)
    if args.json:
        print(json.dumps(told))
        return 0
    rows = {
        "recipe": f"{told['recipe']} ({told['recipe_digest'][:12]})",
        "layout": told["layout"],
        "sequences": f"{told['sequences']} of {told['of_recipe']}",
        "splits": ", ".join(f"{name} {count}" for name, count in told["splits"].items()) or "none",
        "scenes": ", ".join(f"{name} {count}" for name, count in told["scenes"].items()) or "none",
        "labels": ", ".join(told["labels"]) or "none",
        "duration": f"{told['duration_s']:g} s",
        "events": f"{told['events']:,}, {told['events_per_s'] / 1e6:.3g} million a second",
        **{f"  {name}": values for name, values in told["arguments"].items()},
    }
    rows |= {f"failed {entry['index']}": entry["cause"] for entry in told["failed"]}
    width = max(map(len, rows))
    for name, value in rows.items():
        print(printable(f"{name:{width}}  {value}"))
    for note in told["notes"]:
        print(printable(f"note: {note}"))
    return 0
