"""Implements `evis bag`, which records, plays, describes, repairs and exports bags."""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import sys
import textwrap
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from evis.cli.actions import adder, examples_of
from evis.cli.graph.attach import add_run_option, find_run
from evis.cli.parser import UsageError, check_duration
from evis.console.printable import all_printable, printable
from evis.dataset.layouts import LAYOUTS

MOST_ASKED = 3
"""Ctrl-C and SIGTERM end a recording in order; one more ends a close that hangs, as of a pipe that nobody reads."""
HELP = "record, play, describe, repair and export bags"
EXAMPLES = {
    "record": "evis bag record a.mcap --duration 5 --topics '/*/keyframe,/*/depth'",
    "play": "evis bag play a.mcap regenerate:=true --record b.mcap",
    "info": "evis bag info a.mcap --json",
    "recover": "evis bag recover torn.mcap whole.mcap",
    "export": "evis bag export a.mcap --topic /cam0/events events.npz",
}
EXAMPLE = examples_of(EXAMPLES)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    action = adder(parser, EXAMPLES)
    record = action("record", "record topics of a running graph beside it; what it misses is counted")
    record.add_argument("bag", metavar="BAG", help="file to write; an older one is kept as BAG.bak, BAG.bak2, ...")
    record.add_argument("--topics", default="", metavar="GLOB,...", help="topics besides the default ones")
    record.add_argument("--duration", type=float, metavar="S", help="seconds to record (until the graph ends)")
    record.add_argument("--preview-hz", type=float, default=10.0, metavar="HZ", help="rate of the preview images (10)")
    record.add_argument("--event-encoding", default="mono", choices=["mono", "evt3"], help="mono is exact, evt3 1 us")
    record.add_argument(
        "--sync", action="store_true", help="bring the bag to the disk every second, for the case that the machine dies"
    )
    add_run_option(record)
    record.add_argument("--json", action="store_true", help="print JSON")

    play = action("play", "launch replay.yaml: the bag on its topics again; further words go to `evis launch`")
    play.add_argument("bag", metavar="BAG", help="a bag (.mcap)")
    play.add_argument(
        "words", nargs=argparse.REMAINDER, metavar="key:=value | --option",
        help="arguments of the launch file replay and options of `evis launch`; `evis launch replay --help` lists them",
    )  # fmt: skip

    info = action("info", "duration, topics and metadata of a bag")
    info.add_argument("bag", metavar="BAG", help="a bag (.mcap), whole or torn")
    info.add_argument("--json", action="store_true", help="print JSON")

    recover = action("recover", "make a whole bag of a torn one")
    recover.add_argument("bag", metavar="BAG", help="a torn bag; it is not changed")
    recover.add_argument("out", nargs="?", metavar="OUT", help="file to write (BAG.recovered.mcap)")
    recover.add_argument("--json", action="store_true", help="print JSON")

    export = action("export", "write one topic to files, or the whole bag in a layout of data sets")
    export.add_argument("bag", metavar="BAG", help="a bag (.mcap)")
    what = export.add_mutually_exclusive_group(required=True)
    what.add_argument("--topic", metavar="TOPIC", help="as `evis bag info` names it; /env<k>/...")
    what.add_argument("--layout", choices=list(LAYOUTS), metavar="LAYOUT", help=f"one of {', '.join(LAYOUTS)}")
    export.add_argument("--env", type=int, metavar="K", help="with --layout: the environment to take of several")
    export.add_argument(
        "out", metavar="OUT", help="events: .npz .csv .raw; keyframes, images, a layout: a folder; others: .npz .jsonl"
    )
    export.add_argument("--half", action="store_true", help="EXR with 16-bit R, G, B; values beyond 65504 are clamped")
    export.add_argument(
        "--png", action="store_true", help="depth, ids, flow, labels to a folder: 16 bit PNG in place of EXR"
    )
    export.add_argument("--json", action="store_true", help="print JSON")


def run(args: argparse.Namespace) -> int:
    """Runs one action. Raises ValueError or OSError with one line for a person."""
    if args.action == "play":
        from evis.cli import main

        return main(["launch", "replay", f"bag:={args.bag}", *args.words, *(["--debug"] if args.debug else [])])
    actions: dict[str, Callable[[argparse.Namespace], dict[str, Any]]] = {
        "record": _record, "info": _info, "recover": _recover, "export": _export,
    }  # fmt: skip
    result = actions[args.action](args)
    if args.json:
        print(json.dumps(result))
        return 0
    result = all_printable(result)
    if args.action == "info":
        print(_table(result))
    else:
        width = max(map(len, result)) + 2
        for name, value in result.items():
            print(f"{name:<{width}}{value if value not in ('', [], None) else '-'}")
    return 0


def _info(args: argparse.Namespace) -> dict[str, Any]:
    from evis.bag.info import describe

    return describe(args.bag)


def _recover(args: argparse.Namespace) -> dict[str, Any]:
    from evis.bag.recover import recover

    result = dataclasses.asdict(recover(args.bag, args.out))
    return {"out": str(result.pop("path")), **result}


def _export(args: argparse.Namespace) -> dict[str, Any]:
    from evis.bag import BagError
    from evis.bag.export.topics import ENDINGS, FOLDERS, FormatError, export

    if args.layout:
        return _export_layout(args)
    if args.env is not None:
        raise UsageError("--env is for --layout; a topic of environment K is /env<K>/...")
    suffix = Path(args.out).suffix.lower()
    try:
        result = export(args.bag, args.topic, args.out, half=args.half, as_png=args.png)
    except FormatError as error:
        raise UsageError(str(error)) from None
    except BagError:
        if suffix in ("", *ENDINGS):
            raise
        ways = f"events go to {', '.join(ENDINGS)}; any other topic to .npz or .jsonl, keyframes and images to a folder"
        raise UsageError(f"{args.out}: cannot write '{suffix}'; {ways}") from None
    if "other_files" in result:
        exr = "keyframes" in result or "channels" in result
        others = f"{result['other_files']} {FOLDERS['Keyframe' if exr else 'Image']} files"
        print(f"evis bag export: {args.out} holds {others} that are not of this export", file=sys.stderr)
    _tell_missing(args.bag, result)
    return result


def _export_layout(args: argparse.Namespace) -> dict[str, Any]:
    from evis.dataset.bag_sequence import export

    if args.half or args.png:
        raise UsageError("--half and --png are for --topic")
    result = export(args.bag, args.layout, args.out, args.env)
    for note in result["notes"]:
        print(f"evis bag export: {note}", file=sys.stderr)
    _tell_missing(args.bag, result)
    return result


def _tell_missing(bag: str, result: Mapping[str, Any]) -> None:
    """Says on standard error what of a bag could not be exported."""
    if "problem" in result:
        print(
            f"evis bag export: {bag} is torn ({printable(result['problem'])}); what is there was exported; "
            "`evis bag recover` makes a whole bag of it",
            file=sys.stderr,
        )
    if "damaged" in result:
        why = f", the first for: {printable(result['damage'])}" if result["damage"] else ""
        print(
            f"evis bag export: {bag}: {result['damaged']} chunks or messages cannot be read and were left out{why}",
            file=sys.stderr,
        )


def _record(args: argparse.Namespace) -> dict[str, Any]:
    from evis.bag.attach import Taps
    from evis.bag.mcap.path_checks import BagNameError, check_name
    from evis.bag.selection import subscribed, unpublished
    from evis.runtime.process.control import ask_for
    from evis.supervisor.interrupts import Interrupts
    from evis.supervisor.run_directory import is_live
    from nodes.recorder.recorder import Recorder

    check_duration(args.duration)
    if not 0 <= args.preview_hz < math.inf:
        raise UsageError(f"--preview-hz is {args.preview_hz:g}; it must be a number of images per second, 0 = none")
    try:
        check_name(Path(args.bag))
    except BagNameError as error:
        raise UsageError(str(error)) from None
    plan = find_run(args.run)
    globs = [g.strip() for g in args.topics.split(",") if g.strip()]
    publishers = {name: plan.nodes[plan.topics[name].node] for name in plan.open_topics()}
    # A node that starts on demand is started for a topic that is named, as by `evis topic echo`, not for a pattern.
    made = [name for name, node in publishers.items() if node.joins or not node.dormant or name in globs]
    topics = subscribed(made, globs, args.preview_hz)
    for glob in unpublished(made, globs):
        asleep = glob not in unpublished(publishers, globs)
        why = f"{glob}: what starts on demand is recorded where it is named in full" if asleep else (
            f"no node of this graph publishes a topic like '{glob}'")  # fmt: skip
        print(f"evis bag record: {why}", file=sys.stderr)
    recorder = Recorder(args.bag, plan, globs, args.preview_hz, args.event_encoding, args.sync)
    if recorder.writer.backup:
        print(f"evis bag record: the older {args.bag} is now {printable(recorder.writer.backup)}", file=sys.stderr)
    asked = Interrupts(most=MOST_ASKED)  # an exception in the middle of a write would leave half a message
    with asked.counted():
        try:
            for topic in topics:
                if topic in publishers and publishers[topic].dormant:
                    ask_for(plan.directory, topic)
            taps = Taps(plan, topics)
            try:
                taps.run(recorder.receive, args.duration, lambda: not asked.count and is_live(Path(plan.directory)))
            finally:
                taps.close()
        finally:
            recorder.close()
    return {"out": args.bag, "topics": topics, **recorder.counters}


def _table(about: dict[str, Any]) -> str:
    lines = [f"{about['path']}: {about['duration_s']:.6g} s, {about['bytes'] / 1e6:.2f} MB"]
    if about["problem"]:
        lines.append(f"torn: {about['problem']}; `evis bag recover` makes it whole")
    if about["topics"]:
        width = max(map(len, about["topics"])) + 2
        lines.append(f"{'topic':<{width}}{'messages':>9}{'Hz':>10}{'MB':>10}  type")
        for name, topic in about["topics"].items():
            rate = f"{topic.get('rate_hz', 0):.4g}"
            events = f", {topic['events']} events {topic['width']} x {topic['height']}" if "events" in topic else ""
            size = topic["bytes"] / 1e6
            lines.append(f"{name:<{width}}{topic['messages']:>9}{rate:>10}{size:>10.3f}  {topic['type']}{events}")
    for table, values in about["metadata"].items():
        if table not in ("launch", "parameters"):
            lines.append(textwrap.fill(f"{table}: " + ", ".join(_said(values)), 120, subsequent_indent="  "))
    return "\n".join(lines)


def _said(values: dict[str, str]) -> list[str]:
    """What a table of the metadata says, without the arguments that nobody gave."""
    return [f"{key}={value}" for key, value in values.items() if value not in ("None", "null", "")]
