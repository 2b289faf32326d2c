"""Implements `evis bench`, which measures error against run time, stability, throughput."""

from __future__ import annotations

import argparse
import importlib.util
import json
import sys
from pathlib import Path

from evis.cli.parser import UsageError
from evis.config.suggestions import nearest
from evis.console.printable import printable

HELP = "measure, and write the report that docs/performance.md takes its figures from"
EXAMPLE = "example: evis bench graph --quick --out report"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    from bench.report import BY_THEMSELVES, SUBJECTS

    wide = 2 + max(map(len, [*SUBJECTS, *BY_THEMSELVES]))
    subjects = (f"  {name:{wide}}{what}" for name, (_, what) in SUBJECTS.items())
    others = (f"  {module:{wide}}{what}" for module, what in BY_THEMSELVES.items())
    alone = "run by themselves, `python -m bench.ROOM.NAME` (--help):"
    parser.epilog = "\n".join([EXAMPLE, "", "subjects:", *subjects, "", alone, *others])
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("what", nargs="*", metavar="WHAT", help="subjects; all when none is named")
    parser.add_argument("--quick", action="store_true", help="shorter runs: minutes instead of half an hour")
    parser.add_argument("--out", default="report", metavar="DIR", help="where report.json and index.html go (report)")
    parser.add_argument("--docs", metavar="PAGE", help="write the report's figures into the tables of this page")
    parser.add_argument(
        "--from", nargs="+", dest="bags", metavar="BAG", help="measure nothing: error against run time from these bags"
    )
    parser.add_argument("--json", action="store_true", help="print the report as JSON")


def run(args: argparse.Namespace) -> int:
    """Measures and writes the report; exit status 1 when a subject failed."""
    from bench.report import SUBJECTS
    from bench.report import run as measure

    def say(text: str) -> None:
        if sys.stderr.isatty():
            print(text, file=sys.stderr)

    if args.bags:
        return _own_runs(args)
    for subject in args.what:
        if subject not in SUBJECTS:
            raise UsageError(f"no subject '{subject}'; {nearest(subject, SUBJECTS)}")
    if args.docs and not Path(args.docs).is_file():
        raise UsageError(f"--docs {args.docs}: no such page")
    report = measure(args.what or list(SUBJECTS), Path(args.out), args.quick, say)
    if args.docs:
        from bench.documents import update

        update(Path(args.docs), [report])
    if args.json:
        print(json.dumps(report, default=str))
    else:
        print(f"report: {Path(args.out) / 'index.html'}")
    for note in report["notes"]:
        print(f"evis bench: {note}", file=sys.stderr)
    for failure in report["failures"]:
        print(f"evis bench: {failure['subject']} failed: {printable(failure['error'])}", file=sys.stderr)
    return 1 if report["failures"] else 0


def _own_runs(args: argparse.Namespace) -> int:
    """Plots error against run time of recorded runs, from what their bags say."""
    from bench.interpolation.own_runs import plot, read
    from bench.report import NO_PLOTS
    from bench.sections import as_text

    if args.what or args.docs:
        raise UsageError("--from measures nothing: leave out subjects and --docs")
    rows = read(args.bags)
    out = Path(args.out)
    out.mkdir(parents=True, exist_ok=True)
    drawn = importlib.util.find_spec("matplotlib") is not None
    if drawn:
        plot(rows, out / "own_runs.png")
    (out / "own_runs.json").write_text(json.dumps(rows, indent=1) + "\n")
    print(json.dumps(rows) if args.json else as_text({"title": "error against run time", "rows": rows}))
    if not drawn:
        print(f"evis bench: {NO_PLOTS}", file=sys.stderr)
    elif not args.json:
        print(f"plot: {out / 'own_runs.png'}")
    return 0
