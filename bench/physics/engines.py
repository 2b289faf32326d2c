"""Compares MuJoCo Warp with MuJoCo on stiff and extreme cases: how far both are from the truth, and from each other.

    python -m bench.physics.engines [--device cuda] [--cases 8]

Warp's kernels are compiled for each model, minutes on a CPU. An interval in which something looks wrong is stepped
again by MuJoCo itself, in a run as here; the last column counts these.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from pathlib import Path

import numpy as np

from bench.physics import contacts, free, piles, springs
from bench.physics.case import Case
from bench.physics.trial import Method, Trial, run
from evis.geometry import se3

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
    """Runs the first `most` cases by both engines; returns the rows of a table."""
    known = {case.name: case for room in (free, springs, contacts, piles) for case in room.cases(True)}
    found = []
    for step, names in STEPS.items():
        for name in names[:most]:
            with tempfile.TemporaryDirectory() as folder:
                one, other = (run(known[name], Method(INTEGRATOR, step), Path(folder), warp) for warp in (None, device))
            found.append(_row(known[name], one, other))
            print(found[-1], flush=True)
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


if __name__ == "__main__":
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--device", default="cpu", help="of MuJoCo Warp")
    arguments.add_argument("--cases", type=int, default=len(CASES), help="how many, from the first")
    given = arguments.parse_args()
    print(HEAD)
    rows(given.device, given.cases)
