"""Implements `evis launch`, which runs a launch file or a scene as a graph."""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

from evis.cli.parser import Parser, UsageError, check_duration
from evis.config.params import describe_value, limits
from evis.console.printable import printable, printable_lines

if TYPE_CHECKING:
    from evis.supervisor.early import EarlyStart

HELP = "start a graph of nodes from a launch file, or a scene by its name"
EXAMPLE = "example: evis launch spinning_disk omega:=60 --duration 1 --record disk.mcap"
INTERMIXED = True


def add_arguments(parser: Parser) -> None:
    """Declares the command's arguments."""
    parser.add_argument("target", nargs="?", metavar="FILE|NAME", help="launch file or scene, by name or path")
    parser.add_argument(
        "pairs",
        nargs="*",
        metavar="key:=value",
        help="arguments of the launch file or scene; `evis launch NAME --help` lists them",
    )
    parser.add_argument("--duration", type=float, metavar="S", help="simulated (or live) seconds to run")
    parser.add_argument("--record", metavar="BAG", help="record a bag (.mcap)")
    parser.add_argument(
        "--record-topics", metavar="GLOB,...", default="", help="topics to record besides the default ones"
    )
    parser.add_argument(
        "--record-sync", action="store_true", help="bring the bag to the disk every second, in case the machine dies"
    )
    parser.add_argument(
        "--seed", type=int, metavar="N", help="same as seed:=N, of what is random in the graph; --explain says what"
    )
    parser.add_argument("--compose", action="store_true", help="all nodes but the visualizer in one process")
    parser.add_argument("--split", action="store_true", help="every node in a process of its own")
    parser.add_argument("--no-view", action="store_true", help="no visualizer (also: EVIS_NO_VIEW=1)")
    parser.add_argument("--explain", action="store_true", help="print what would run and what is left out, and exit")
    parser.add_argument(
        "--no-import", action="store_true", help="with --explain: load no node that does not come with evis"
    )
    parser.add_argument("--json", action="store_true", help="print the summary (or the plan) as JSON")
    named = next((w for w in parser.words if not w.startswith("-")), None)
    if named and any(w in ("-h", "--help") for w in parser.words):
        parser.epilog = _arguments_text(named) + EXAMPLE
    elif any(w in ("-h", "--help") for w in parser.words):
        parser.epilog = _installed() + EXAMPLE


def _installed() -> str:
    """What may be named: launch files and scenes that are installed, and the sensors that `preset:=` knows."""
    from evis.config import paths
    from nodes.event_sensor.presets import PRESETS

    there = {
        "launch files": paths.names("launch"),
        "scenes": paths.names("scenes"),
        "sensors for preset:=": list(PRESETS),
    }
    lines = [fill(f"{what}: {', '.join(names)}", 100, subsequent_indent="  ") for what, names in there.items()]
    return "\n".join([*lines, "`evis launch NAME --help` lists the arguments of one.", ""])


def _arguments_text(name: str) -> str:
    """What the help says about one launch file."""
    from evis.launch.target import read_target, scene_arguments

    target = read_target(name)
    launch, preset = target.launch, target.preset
    own = scene_arguments(launch, preset)
    scene = preset.get("scene") or (launch.arguments["scene"].param.default if own else "")
    width = max(map(len, [*launch.arguments, *own]), default=0) + 1
    lines = [f"arguments of scene {scene}:", *(_line(key, param, width) for key, param in own.items())] if own else []
    lines += [f"{launch.path.name}: {launch.description}", "arguments:"]
    for key, argument in launch.arguments.items():
        required = argument.required and key not in preset
        lines.append(_line(key, argument.param, width, None if argument.param.secret else preset.get(key), required))
    return "\n".join(lines) + "\n\n"


def _line(key: str, param: Any, width: int, default: Any = None, required: bool = False) -> str:
    default = None if param.secret else param.default if default is None else default
    notes = ["secret: as env:NAME or file:PATH it does not show in ps"] if param.secret else []
    notes += ["required"] if required else []
    if default is not None and not notes:
        notes.append(f"default {describe_value(default)}" + (f" {param.unit}" if param.unit else ""))
    elif param.optional and limits(param):
        notes.append(limits(param))
    if notes and param.minimum is not None and param.maximum is not None and not param.optional:
        # Where whole numbers end is no limit that anybody wants to know.
        notes += [f"{param.minimum:g} to {param.maximum:g}"] if param.maximum < 2**62 else []
    if param.choices:
        notes.append(f"one of {', '.join(map(str, param.choices))}")
    return f"  {key:<{width}} {param.help}" + (f" ({', '.join(notes)})" if notes else "")


def run(args: argparse.Namespace) -> int:
    """Plans, explains or runs the graph."""
    from evis.supervisor.early import early_start

    name = process_to_start_early(args)
    early = early_start(name) if name else None
    try:
        return _run(args, early)
    finally:
        if early is not None:
            early.close()


def process_to_start_early(args: argparse.Namespace) -> str:
    """Names the process of a scene's graph that takes longest to get ready; "" of other graphs and where none runs."""
    from evis.config import paths
    from evis.runtime.plan import COMPOSED

    if args.explain or args.target is None:
        return ""
    try:
        _, of_scene = paths.find_launch(args.target)
    except FileNotFoundError:
        return ""  # the plan says so
    if not of_scene:
        return ""
    if args.split:
        return "interpolator"
    on_gpu = any(pair.startswith("device:=cuda") for pair in args.pairs)
    return COMPOSED if args.compose or on_gpu else "sensor"  # as launch/simulator.yaml has it


def _run(args: argparse.Namespace, early: EarlyStart | None) -> int:
    """Plans a graph, and explains or runs it; early: what was started before its plan."""
    from evis.launch.arguments import ArgumentError
    from evis.launch.explain import as_dict, as_text

    try:
        plan = make_plan(args)
    except ArgumentError as error:
        raise UsageError(str(error)) from None
    if args.explain:
        print(json.dumps(as_dict(plan)) if args.json else printable_lines(as_text(plan)))
        return 0
    from evis.cli.progress import Progress
    from evis.supervisor.supervisor import Supervisor

    if plan.chosen:
        print(f"interpolator auto: {printable(plan.chosen['summary'])}", file=sys.stderr, flush=True)
    with Progress(plan.duration_s) as progress:
        supervisor = Supervisor(plan, say=progress.say, tick=progress.tick, debug=args.debug, early=early)
        report = supervisor.run()
    if report.failure is not None:
        print(f"evis launch: {printable(report.failure)}", file=sys.stderr)
    if args.json:
        print(json.dumps(report.summary))
    elif report.failure is None:
        from evis.supervisor.report import as_table

        print(printable_lines(as_table(report)))
    return 0 if report.failure is None else 1


def make_plan(args: argparse.Namespace) -> Any:
    """Makes the plan that the command line asks for."""
    from evis.bag.mcap.path_checks import BagNameError, check_name
    from evis.cli.graph.auto import measuring_shown, warn
    from evis.config import paths
    from evis.launch.arguments import parse_pairs
    from evis.launch.graph.checks import check_bag
    from evis.launch.planner import Options, plan_launch
    from evis.launch.target import read_target
    from evis.simulation.auto import without_auto

    if args.target is None:
        known = sorted({*paths.names("launch"), *paths.names("scenes")})
        raise UsageError(f"name a launch file or a scene: {', '.join(known)}")
    if args.no_import and not args.explain:
        raise UsageError("--no-import is for --explain: a graph cannot run without its nodes")
    if args.compose and args.split:
        raise UsageError("--compose and --split exclude each other")
    check_duration(args.duration)
    target = read_target(args.target, parse_pairs(args.pairs))
    launch, given = target.launch, target.given
    if args.seed is not None:
        if "seed" in given:
            raise UsageError(f"the seed is given twice, as --seed {args.seed} and seed:={given['seed']}")
        given["seed"] = args.seed
    if args.record:
        try:
            check_name(Path(args.record))
        except BagNameError as error:
            raise UsageError(f"--record: {error}") from None
        check_bag(Path(args.record), "--record")
    options = Options(
        duration_s=args.duration,
        record=args.record,
        record_topics=tuple(t.strip() for t in args.record_topics.split(",") if t.strip()),
        record_sync=args.record_sync,
        view=not args.no_view and os.environ.get("EVIS_NO_VIEW", "") in ("", "0"),
        grouping="compose" if args.compose else "split" if args.split else "default",
        explain=args.explain,
        no_import=args.no_import,
    )
    if options.record_topics and not options.record:
        raise UsageError("--record-topics needs --record BAG")
    if options.record_sync and not options.record:
        raise UsageError("--record-sync needs --record BAG")
    chosen = without_auto(launch, given, options, measuring_shown(), warn)
    plan = plan_launch(launch, chosen.given, options, chosen.must_have_effect)
    plan.chosen = chosen.told
    plan.name = target.name
    return plan
