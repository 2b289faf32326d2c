"""Implements `evis doctor`, which says what this machine and this installation can do, and what to change where they
cannot."""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import asdict
from pathlib import Path

from evis.cli.machine.doctor_checks import Finding, check
from evis.cli.parser import UsageError
from evis.console.printable import printable

HELP = "check this machine and this installation"
EXAMPLE = "examples: evis doctor --json; evis doctor --warm, once after the installation"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the command's arguments."""
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument(
        "--warm",
        action="store_true",
        help="also compile the kernels of every scene and of usual sensors, methods and labels, which takes minutes: "
        "first runs do not wait for them then",
    )
    parser.add_argument(
        "--device", help="for --warm: cpu, cuda or cuda:N; not given = cuda where there is one, and cpu"
    )


def run(args: argparse.Namespace) -> int:
    """Runs every check, then --warm; exit status 1 when one fails."""
    if args.device and not args.warm:
        raise UsageError("--device is for --warm")
    findings = list(check())
    if args.warm and not any(f.level == "fail" for f in findings):
        findings += [_warmed(device) for device in _devices(args.device)]
    if args.json:
        print(
            json.dumps({"findings": [asdict(f) for f in findings], "ok": not any(f.level == "fail" for f in findings)})
        )
    else:
        width = max(len(f.name) for f in findings)
        for f in findings:
            print(f"{f.level:<5} {f.name:<{width}}  {printable(f.text)}")
    failed = [f.name for f in findings if f.level == "fail"]
    if failed:
        raise ValueError(f"{len(failed)} check(s) failed: {', '.join(failed)}")
    return 0


def _devices(given: str | None) -> list[str]:
    from evis.gpu.devices import device_named

    if given:
        return [str(device_named(given))]
    import warp as wp

    return ["cpu", "cuda"] if wp.is_cuda_available() else ["cpu"]


def _warmed(device: str) -> Finding:
    import warp as wp

    from evis.cli.machine.warm import runs, warm

    folder, began = Path(wp.config.kernel_cache_dir or ""), time.monotonic()
    before = len(list(folder.glob("wp_*")))
    wanted = runs()
    failed = warm(device, wanted, lambda line: print(f"warm  {device} {printable(line)}", file=sys.stderr))
    compiled = len(list(folder.glob("wp_*"))) - before
    text = f"{len(wanted) - len(failed)} of {len(wanted)} runs, {compiled} sets of kernels "
    text += f"compiled in {time.monotonic() - began:.0f} s"
    if failed:
        text += "; failed: " + ", ".join(f"{name} ({why})" for name, why in failed.items())
    return Finding(f"warm {device}", "fail" if failed else "ok", text)
