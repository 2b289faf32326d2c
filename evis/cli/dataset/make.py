"""Implements `evis dataset make`, which makes the sequences of a recipe, by processes of this machine or a Ray
cluster."""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys

from evis.cli.parser import UsageError
from evis.console.printable import printable

HELP = "make the sequences of a recipe"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the action's arguments."""
    parser.add_argument("recipe", metavar="RECIPE", help="recipe: a path, or the name of one in recipes/")
    parser.add_argument("--out", required=True, metavar="DIR", help="folder, or s3://... (evis[cluster])")
    parser.add_argument("--count", type=int, metavar="N", help="how many sequences, in place of what the recipe says")
    parser.add_argument("--duration", type=float, metavar="S", help="length of each, in place of what the recipe says")
    parser.add_argument("--workers", type=int, metavar="N", help="processes; not given, one per core, or per GPU")
    parser.add_argument(
        "--batch", type=int, metavar="N",
        help="sequences that a worker makes at once; not given, 1 on a CPU, and on a GPU what its memory holds",
    )  # fmt: skip
    parser.add_argument("--address", metavar="CLUSTER", help="a Ray cluster, `auto` for this machine's (evis[cluster])")
    parser.add_argument("--resume", action="store_true", help="go on with a data set that was begun")


def run(args: argparse.Namespace) -> int:
    """Makes the sequences that are not there yet; returns 1 where one has failed."""
    for name in ("count", "workers", "batch"):
        if (value := getattr(args, name)) is not None and value < 1:
            raise UsageError(f"--{name} is {value}; the least is 1")
    from evis.cli.dataset.progress import SequenceProgress
    from evis.dataset.making.make import make
    from evis.dataset.making.workforce import usual_batch, workforce
    from evis.dataset.recipe_file import UnknownRecipe, read_recipe

    try:
        recipe = read_recipe(args.recipe, args.duration)
    except UnknownRecipe as error:
        raise UsageError(str(error)) from None
    wanted = recipe.count if args.count is None else args.count
    workers = workforce(recipe, args.workers, args.address)
    batch = args.batch or usual_batch(recipe, wanted, args.workers)
    with SequenceProgress() as progress:
        made = make(recipe, args.out, workers, args.count, args.resume, progress.tick, progress.say, batch=batch)
    if args.json:
        print(json.dumps({**dataclasses.asdict(made), "out": args.out, "wanted": wanted}))
    else:
        rate = f", {3600 * made.made / made.seconds:,.0f} an hour" if made.seconds else ""
        print(printable(f"{args.out}: {made.there} sequences, {made.made} made now, {made.events:,} events{rate}"))
    if made.stopped:
        left = f"{made.there} sequences are there and whole; --resume goes on"
        print(f"evis dataset: {printable(made.stopped)}; {left}", file=sys.stderr)
    elif made.failed:
        count = f"{len(made.failed)} of {wanted} sequences failed"
        print(f"evis dataset: {count}, dataset.json says why; --resume tries them again", file=sys.stderr)
    return 1 if made.stopped or made.failed else 0
