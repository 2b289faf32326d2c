"""Counts the sequences per hour that `evis dataset make` and a shell loop of `evis launch ... --record` produce.

    evis bench dataset [--quick]

Both make the same sequences of recipes/rotation.yaml, of 1 s at 346x260, on the same machine, one after the other: the
quotient is what counts. Kernels are compiled before. CPU time, of all processes, counts other programs of the machine
less than the clock does.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bench import command
from evis.dataset.recipe import Plan
from evis.dataset.recipe_file import find_recipe, read_recipe

PROGRAM = [sys.executable, "-m", "evis"]
CASES: tuple[tuple[str, str, str | None], ...] = (
    ("events alone", "npz", "[]"),
    ("events alone", "dsec", "[]"),
    ("flow and boxes", "dsec", None),
)
"""What is made, layout, and labels where they are not the recipe's."""


def clock() -> np.ndarray:
    """Reads the clock and the CPU time of all child processes that have ended, float64 [2] s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return np.array([time.perf_counter(), used.ru_utime + used.ru_stime])


def loop_time(plans: Sequence[Plan], folder: Path) -> np.ndarray:
    """Runs one `evis launch` after the other, each into a bag; returns the clock and CPU time spent, as `clock`."""
    began = clock()
    for plan in plans:
        words = [f"{name}:={_text(value)}" for name, value in plan.arguments.items()]
        if plan.labels:
            words.append(f"labels:={','.join(plan.labels)}")
        run(["launch", plan.scene, *words, f"seed:={plan.seed}", "--duration", f"{plan.duration_s:g}", "--no-view",
             "--record", str(folder / f"{plan.name}.mcap")])  # fmt: skip
    return clock() - began


def _text(value: Any) -> str:
    return ",".join(map(repr, value)) if isinstance(value, list) else str(value)


def make_time(recipe: Path, count: int, folder: Path) -> np.ndarray:
    """Runs `evis dataset make`, its own start included; returns the clock and CPU time spent, as `clock`."""
    began = clock()
    run(["dataset", "make", str(recipe), "--count", str(count), "--out", str(folder)])
    return clock() - began


def run(words: Sequence[str]) -> None:
    """Runs a command of evis. Raises RuntimeError with what it says where it fails."""
    done = subprocess.run([*PROGRAM, *words], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    if done.returncode:
        raise RuntimeError(done.stderr.strip())


def recipe_text(layout: str, labels: str | None) -> str:
    """Gives rotation.yaml with another layout, and perhaps other labels."""
    lines = find_recipe("rotation").read_text().splitlines()
    changed = {"layout:": f"layout: {layout}"} | ({} if labels is None else {"labels:": f"labels: {labels}"})
    return "\n".join(next((new for key, new in changed.items() if line.startswith(key)), line) for line in lines)


def row(what: str, layout: str, labels: str | None, count: int) -> dict[str, Any]:
    """Makes the same sequences by the shell loop and by `evis dataset make`; returns a row that compares them."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        recipe = folder / "rotation.yaml"
        recipe.write_text(recipe_text(layout, labels))
        plans = read_recipe(recipe).sequences(count)
        run(["dataset", "make", str(recipe), "--count", "1", "--workers", "1", "--out", str(folder / "first")])
        loop = loop_time(plans, folder)
        made = make_time(recipe, count, folder / "d")
        size = sum(path.stat().st_size for path in (folder / "d").rglob("*") if path.is_file())
    return {
        "sequences of 1 s": what,
        "layout": layout,
        "number": count,
        "shell loop [1/h]": round(3600 * count / loop[0]),
        "dataset make [1/h]": round(3600 * count / made[0]),
        "times as many": round(loop[0] / made[0], 2),
        "CPU of the loop [s each]": round(loop[1] / count, 2),
        "of dataset make": round(made[1] / count, 2),
        "megabytes each": round(size / count / 1e6, 1),
    }


def measure(quick: bool = False) -> dict[str, Any]:
    """Measures every case."""
    count = 6 if quick else 20
    return {
        "making": {
            "title": f"Sequences per hour, {len(os.sched_getaffinity(0))} cores",
            "command": "evis bench dataset",
            "rows": [row(*case, count) for case in CASES],
            "note": "rotation.yaml, 346x260. The shell loop runs `evis launch spinning_disk ... --record BAG`, "
            "whose bag still has to be brought into a layout. Start-up counts in both.",
        }
    }


if __name__ == "__main__":
    command.run(measure, __doc__ or "")
