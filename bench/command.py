"""Runs one benchmark from the command line: `python -m bench.ROOM.NAME [--quick] [--json] [--out FILE]`."""

from __future__ import annotations

import argparse
import json
import os
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
    parser = parser_of(module, description)
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
    if args.out:
        check_file(parser, "--out", args.out)
    if device:
        check_device(parser, args.device, gpu_only=device == "cuda")
    own = {name: value for name, value in vars(args).items() if name not in common}
    sections = measure(args.quick, args.device, **own) if device else measure(args.quick, **own)
    if not sections:
        parser.exit(1, f"{parser.prog}: nothing was measured: no row is what these options ask for\n")
    if args.out:
        report = report_of({subject_of(module): sections}, args.quick)
        args.out.write_text(json.dumps(report, indent=1, default=str) + "\n")
    print(json.dumps(sections, default=str) if args.json else "\n".join(map(as_text, sections.values())))


def parser_of(module: str, description: str) -> argparse.ArgumentParser:
    """Makes the parser of a benchmark's command line, which has the name by which it is run."""
    return argparse.ArgumentParser(
        prog=f"python -m {module}", description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )


def count(text: str) -> int:
    """Reads an option that says how many, 1 or more. Raises ArgumentTypeError."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of 1 or more")
    return int(text)


def check_file(parser: argparse.ArgumentParser, option: str, path: Path) -> None:
    """Ends the program where a file cannot be written, before anything is measured for it."""
    if path.is_dir():
        parser.error(f"{option} {path} is a folder; name a file")
    if not path.parent.is_dir():
        parser.error(f"{option} {path}: there is no folder {path.parent}; make it first")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        parser.error(f"{option} {path} cannot be written; name another file")


def name_of(measure: Callable[..., Any]) -> str:
    """Gives the name by which a function's module is imported, also where it is run as the main module."""
    spec = sys.modules[measure.__module__].__spec__
    return spec.name if spec else measure.__module__


def subject_of(module: str) -> str:
    """Gives the name of a benchmark in a report: that of `evis bench`, else the module's, such as renderer.gpu."""
    return next((subject for subject, (path, _) in SUBJECTS.items() if path == module), module.removeprefix("bench."))


def check_device(parser: argparse.ArgumentParser, device: str, gpu_only: bool = False) -> None:
    """Ends the program where `device` (cpu, auto, cuda or cuda:N) is none, or is not there."""
    import warp as wp

    if device in ("cpu", "auto") and not gpu_only:
        return
    if not device.startswith("cuda"):
        parser.error(f"--device is {device!r}; it can be " + ("" if gpu_only else "cpu, ") + "cuda or cuda:N")
    wp.init()
    if not wp.is_cuda_available():
        parser.exit(1, f"{parser.prog}: there is no CUDA device here\n")
    there = [str(found) for found in wp.get_cuda_devices()]
    if device != "cuda" and device not in there:
        parser.exit(1, f"{parser.prog}: there is no device {device} here; there are {', '.join(there)}\n")
