"""`evis launch`: a launch file or a scene as a running graph."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

from evis.cli.parser import Parser, UsageError
from evis.console.printable import printable, printable_lines

HELP = "start a graph of nodes from a launch file, or a scene by its name"
EXAMPLE = "example: evis launch spinning_disk omega:=60 --duration 1 --record disk.mcap"
INTERMIXED = True


def add_arguments(parser: Parser) -> None:
    """Declare the command's arguments."""
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
    from evis.config import paths
    from evis.launch.files import load
    from evis.scene.load import scene_args

    path, preset = paths.find_launch(name)
    launch = load(path)
    scene = preset.get("scene", "")
    own = {key: param for key, param in scene_args(scene).items() if key not in launch.arguments} if scene else {}
    width = max(map(len, [*launch.arguments, *own]), default=0) + 1
    lines = [f"arguments of scene {scene}:", *(_line(key, param, width) for key, param in own.items())] if own else []
    lines += [f"{path.name}: {launch.description}", "arguments:"]
    for key, argument in launch.arguments.items():
        required = argument.required and key not in preset
        lines.append(_line(key, argument.param, width, None if argument.param.secret else preset.get(key), required))
    return "\n".join(lines) + "\n\n"


def _line(key: str, param: Any, width: int, default: Any = None, required: bool = False) -> str:
    default = None if param.secret else param.default if default is None else default
    notes = ["secret: as env:NAME or file:PATH it does not show in ps"] if param.secret else []
    notes += ["required"] if required else []
    if default is not None and not notes:
        notes.append(f"default {_shown(default)}" + (f" {param.unit}" if param.unit else ""))
    if param.minimum is not None and param.maximum is not None:
        # Where whole numbers end is no limit that anybody wants to know.
        notes += [f"{param.minimum:g} to {param.maximum:g}"] if param.maximum < 2**62 else []
    if param.choices:
        notes.append(f"one of {', '.join(map(str, param.choices))}")
    return f"  {key:<{width}} {param.help}" + (f" ({', '.join(notes)})" if notes else "")


def _shown(value: Any) -> str:
    if isinstance(value, list):
        return ",".join(map(str, value)) or "none"
    return "none" if value in (None, "") else str(value)


def run(args: argparse.Namespace) -> int:
    """Plan, explain or run."""
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
        report = Supervisor(plan, say=progress.say, tick=progress.tick, debug=args.debug).run()
    if report.failure is not None:
        print(f"evis launch: {printable(report.failure)}", file=sys.stderr)
    if args.json:
        print(json.dumps(report.summary))
    elif report.failure is None:
        from evis.supervisor.report import as_table

        print(printable_lines(as_table(report)))
    return 0 if report.failure is None else 1


def make_plan(args: argparse.Namespace) -> Any:
    """The plan that the command line asks for."""
    from evis.config import paths
    from evis.launch.checks import check_writable
    from evis.launch.planner import Options, plan_launch

    if args.target is None:
        known = sorted({*paths.names("launch"), *paths.names("scenes")})
        raise UsageError(f"name a launch file or a scene: {', '.join(known)}")
    if args.no_import and not args.explain:
        raise UsageError("--no-import is for --explain: a graph cannot run without its nodes")
    if args.compose and args.split:
        raise UsageError("--compose and --split exclude each other")
    if args.duration is not None and not 0 < args.duration < 1e9:
        raise UsageError(f"--duration is {args.duration:g}; it must be a time longer than 0 and less than 1e9 s")
    launch, given, preset = read_target(args.target, args.pairs)
    if args.seed is not None:
        if "seed" in given:
            raise UsageError(f"the seed is given twice, as --seed {args.seed} and seed:={given['seed']}")
        given["seed"] = args.seed
    if args.record:
        check_writable(Path(args.record), "--record")
    options = Options(
        duration_s=args.duration,
        record=args.record,
        record_topics=tuple(t.strip() for t in args.record_topics.split(",") if t.strip()),
        record_sync=args.record_sync,
        view=not args.no_view and os.environ.get("EVIS_NO_VIEW", "") in ("", "0"),
        grouping="compose" if args.compose else "split" if args.split else "default",
        no_import=args.no_import,
    )
    if options.record_topics and not options.record:
        raise UsageError("--record-topics needs --record BAG")
    if options.record_sync and not options.record:
        raise UsageError("--record-sync needs --record BAG")
    from evis.cli.graph.auto import WARP, resolve_auto

    given, chosen = resolve_auto(launch, given, options)
    # Where the method is chosen by measuring, what is only for some methods was given for the case.
    held = None if not chosen else [key for key in given if key not in (*WARP, "adaptive_px")]
    plan = plan_launch(launch, given, options, held)
    plan.chosen = chosen
    if preset:
        plan.name = preset["scene"]
    return plan


def read_target(target: str, words: Sequence[str]) -> tuple[Any, dict[str, Any], dict[str, str]]:
    """(launch file of a FILE|NAME, the arguments given to it, those among them that the name stands for).

    words: key:=value. What is for the scene is among its scene_args. Raises UsageError, ArgumentError and LaunchError.
    """
    from evis.config import paths
    from evis.launch.arguments import parse_pairs
    from evis.launch.files import load

    path, preset = paths.find_launch(target)
    launch = load(path)
    pairs = parse_pairs(words)
    for key, value in preset.items():
        if key in pairs:
            raise UsageError(f"the {key} is given twice, as {value} and {key}:={pairs[key]}")
    given: dict[str, Any] = {**preset, **pairs}
    if "scene" in given and "scene_args" in launch.arguments:
        given = _scene_arguments(given, list(launch.arguments), launch.path.name)
    return launch, given, preset


def _scene_arguments(given: dict[str, Any], known: Sequence[str], file: str) -> dict[str, Any]:
    """What the launch file `file` does not know goes to the scene. Raises ArgumentError."""
    from evis.config.document import nearest
    from evis.launch.arguments import ArgumentError
    from evis.scene.load import scene_args

    try:
        scene = scene_args(given["scene"])
    except FileNotFoundError as error:
        raise ArgumentError(f"{file}: {error}") from None
    for key in given:
        if key not in known and key not in scene:
            hint = nearest(key, [*(k for k in scene if k not in known), *known])
            raise ArgumentError(f"neither scene {Path(given['scene']).stem} nor {file} has '{key}'; {hint}")
    own = {k: v for k, v in given.items() if k in scene and k not in known}
    if not own:
        return given
    text = ",".join([given.get("scene_args", ""), *(f"{k}={v}" for k, v in own.items())]).strip(",")
    return {k: v for k, v in given.items() if k not in own} | {"scene_args": text}
