"""Runs one benchmark from the command line: `python -m bench.ROOM.NAME [--quick] [--json] [--out FILE]`."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from bench.report import SUBJECTS, report_of
from bench.sections import as_text


def run(
    measure: Callable[..., dict[str, Any]],
    description: str,
    device: str = "",
    argv: Sequence[str] | None = None,
    options: Callable[[argparse.ArgumentParser], None] | None = None,
) -> None:
    """Parses the options, measures, and prints the sections as tables or as JSON.

    Args:
        measure: `measure(quick)`, or `measure(quick, device)` of a benchmark that has the option --device.
        description: what --help prints.
        device: default of --device, `cuda` where only a GPU is measured, `auto` for a GPU where there is one; none:
            there is no such option.
        argv: the arguments, without the program's name; those of the process when not given.
        options: declares options of the benchmark's own, which `measure` gets by their names.
    """
    module = name_of(measure)
    parser = argparse.ArgumentParser(
        prog=f"python -m {module}", description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="less data, fewer repetitions")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write a report as `evis bench` does")
    if device:
        kinds = "cuda or cuda:N" if device == "cuda" else "cpu, cuda or cuda:N"
        default = "a GPU where there is one" if device == "auto" else device
        parser.add_argument("--device", default=device, help=f"{kinds}; {default} when not given")
    common = set(vars(parser.parse_args([])))
    if options is not None:
        options(parser)
    args = parser.parse_args(argv)
    if device:
        _check_device(parser, args.device, gpu_only=device == "cuda")
    own = {name: value for name, value in vars(args).items() if name not in common}
    sections = measure(args.quick, args.device, **own) if device else measure(args.quick, **own)
    if args.out:
        report = report_of({subject_of(module): sections}, args.quick)
        args.out.write_text(json.dumps(report, indent=1, default=str) + "\n")
    print(json.dumps(sections, default=str) if args.json else "\n".join(map(as_text, sections.values())))


def name_of(measure: Callable[..., Any]) -> str:
    """Gives the name by which a function's module is imported, also where it is run as the main module."""
    spec = sys.modules[measure.__module__].__spec__
    return spec.name if spec else measure.__module__


def subject_of(module: str) -> str:
    """Gives the name of a benchmark in a report: that of `evis bench`, else the module's, such as renderer.gpu."""
    return next((subject for subject, (path, _) in SUBJECTS.items() if path == module), module.removeprefix("bench."))


def _check_device(parser: argparse.ArgumentParser, device: str, gpu_only: bool) -> None:
    import warp as wp

    if device in ("cpu", "auto") and not gpu_only:
        return
    if not device.startswith("cuda"):
        parser.error(f"--device is {device!r}")
    wp.init()
    if not wp.is_cuda_available():
        parser.exit(1, f"{parser.prog}: there is no CUDA device here\n")
