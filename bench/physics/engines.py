"""Compares MuJoCo Warp with MuJoCo on stiff and extreme cases: how far both are from the truth, and from each other.

    python -m bench.physics.engines [--device cuda] [--cases 8]

Warp's kernels are compiled for each model, minutes on a CPU. An interval in which something looks wrong is stepped
again by MuJoCo itself, in a run as here; the last column counts these.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bench import command
from bench.physics import contacts, free, piles, springs
from bench.physics.case import Case
from bench.physics.trial import Method, Trial, run
from evis.geometry import se3
from nodes.physics.dynamics.batch.unsupported import Unsupported

CASES = (
    "projectile",
    "asymmetric body turning freely",
    "spring of 1e4 N/m and 1 kg, undamped",
    "spring of 1e6 N/m and 1 kg, undamped",
    "ball that bounces without loss",
    "ball that slides, then rolls",
    "block on a slope of 30 degrees, mu 0.5",
    "bullet of 100 m/s at a wall of 1 cm, hard contacts",
    "stack of 10 boxes, default contacts",
    "stack of 10 boxes, hard contacts",
    "1 kg below 1,000 kg, hard contacts",
    "1 mm on 100 m, hard contacts",
    "heap of 216 balls, hard contacts",
    "chain of 50 links",
)
"""Smooth motion, stiff springs, contacts of all kinds, mass ratios, sizes far apart, many bodies."""
STEPS = {1_000_000: CASES, 62_500: tuple(name for name in CASES if "hard" in name and "heap" not in name)}
"""Steps [ns]: that of a run, and one in which hard contacts do not explode; cases by step."""
INTEGRATOR = "implicitfast"
HEAD = (
    "| case | step | unit | limit | MuJoCo | MuJoCo Warp | apart | stepped again |\n|---|---|---|---|---|---|---|---|"
)


def rows(device: str, most: int) -> list[str]:
    """Runs the first `most` cases by both engines; returns the rows of a table, each printed when it is there.

    Raises Unsupported where MuJoCo Warp is not installed or cannot take a case.
    """
    known = {case.name: case for room in (free, springs, contacts, piles) for case in room.cases(True)}
    found: list[str] = []
    for step, names in STEPS.items():
        for name in names[:most]:
            with tempfile.TemporaryDirectory() as folder:
                one, other = (run(known[name], Method(INTEGRATOR, step), Path(folder), warp) for warp in (None, device))
            row = _row(known[name], one, other)
            print(row if found else f"{HEAD}\n{row}", flush=True)
            found.append(row)
    return found


def _row(case: Case, one: Trial, other: Trial) -> str:
    assert one.course is not None and other.course is not None
    shared = min(len(one.course.t), len(other.course.t))
    first, second = one.course.pose[:shared], other.course.pose[:shared]
    apart = np.linalg.norm(first[..., :3] - second[..., :3], axis=-1).max()
    turn = se3.multiply(se3.conjugate(first[..., 3:]), second[..., 3:])
    angle = np.degrees(2 * np.arctan2(np.linalg.norm(turn[..., :3], axis=-1), np.abs(turn[..., 3]))).max()
    errors = " | ".join("diverged" if math.isnan(trial.error) else f"{trial.error:.2g}" for trial in (one, other))
    intervals = math.ceil(case.seconds / 0.02 - 1e-9)
    again = f"{other.checked} of {intervals}"
    what = f"{case.name} | {one.method.step} | {case.unit} | {case.limit:g}"
    return f"| {what} | {errors} | {apart:.1g} m, {angle:.1g} deg | {again} |"


def main(argv: Sequence[str] | None = None) -> None:
    """Runs the command line."""
    parser = command.parser_of("bench.physics.engines", __doc__ or "")
    parser.add_argument("--device", default="cpu", help="of MuJoCo Warp: cpu (when not given), cuda or cuda:N")
    most = f"how many, from the first; all {len(CASES)} when not given"
    parser.add_argument("--cases", type=command.count, default=len(CASES), metavar="N", help=most)
    given = parser.parse_args(argv)
    command.check_device(parser, given.device)
    try:
        rows(given.device, given.cases)
    except Unsupported as why:
        parser.exit(1, f"{parser.prog}: MuJoCo Warp: {why}\n")


if __name__ == "__main__":
    main()
