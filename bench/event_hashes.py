"""Hashes the events of every scene, preset and interpolator, to show whether a change of the code has changed any.

    python -m bench.event_hashes --out NEW.json --events new [--scenes drone,warehouse] [--device cuda] [--jobs 2]
    python -m bench.event_hashes --compare OLD.json NEW.json

Each case is the graph that `evis launch` starts, held in this process by evis.Simulation: 96 x 72 pixels, 0.2 s,
seed 1. Of the events of each camera the file holds the SHA-256 of every column, how many there are of
each polarity, and the first and last time; --events keeps the events themselves, so that a difference can be sized.
"""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
import sys
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from bench import command
from bench.event_differences import differences, file_of
from bench.report import machine
from evis.config import paths

WIDTH, HEIGHT = 96, 72
DURATION_S = 0.2
SEED = 1
PRESETS = ("ideal", "davis346", "imx636")
INTERPOLATORS = ("rigid", "splat", "none")
COLUMNS = {"t": "<i8", "x": "<u2", "y": "<u2", "p": "u1", "c": "u1"}
"""Of an event; c where events have a colour."""

Case = tuple[str, str, str]
"""Scene, preset, interpolator."""


def events_of(case: Case, device: str) -> dict[str, dict[str, np.ndarray]]:
    """Runs one case in this process: camera -> column -> values. Raises SimulationError."""
    from evis import Simulation, SimulationWarning
    from evis.simulation.step import on_host

    scene, preset, interpolator = case
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SimulationWarning)  # what nodes say of light and motion is no matter here
        with Simulation(
            scene, seed=SEED, preset=preset, interpolator=interpolator, device=device, width=WIDTH, height=HEIGHT
        ) as sim:
            steps = [*sim.run(DURATION_S), sim.finish()]
            found = {}
            for camera in sim.cameras:
                packets = [step.cameras[camera].events for step in steps]
                parts = [on_host(packet) for packet in packets if packet is not None]
                columns = {name: [getattr(part, name) for part in parts] for name in COLUMNS}
                found[camera] = {
                    name: np.concatenate(values).astype(COLUMNS[name])
                    for name, values in columns.items()
                    if values and values[0] is not None
                }
    return found


def row_of(columns: dict[str, np.ndarray]) -> dict[str, Any]:
    """Makes the file's row for one camera's events."""
    if not columns:
        return {"events": 0, "sha256": {}}
    t, p = columns["t"], columns["p"]
    row: dict[str, Any] = {"events": len(t), "on": int((p == 1).sum()), "off": int((p == 0).sum())}
    if len(t):
        row |= {"t_first_ns": int(t[0]), "t_last_ns": int(t[-1])}
    return row | {"sha256": {name: hashlib.sha256(values.tobytes()).hexdigest() for name, values in columns.items()}}


def run_case(case: Case, device: str, keep: Path | None) -> tuple[Case, dict[str, Any], str]:
    """Runs a case: (case, row by `scene/preset/interpolator/camera`, why it failed or "").

    keep: folder for the events."""
    rows = {}
    try:
        for camera, columns in events_of(case, device).items():
            name = "/".join((*case, camera))
            rows[name] = row_of(columns)
            if keep is not None:
                np.savez_compressed(keep / file_of(name), **columns)  # type: ignore[arg-type]
    except Exception as error:  # one case that fails must not cost the others; it is listed
        return case, {}, f"{type(error).__name__}: {error}"
    return case, rows, ""


def run_all(
    cases: Sequence[Case], device: str, jobs: int, keep: Path | None
) -> Iterator[tuple[Case, dict[str, Any], str]]:
    """Runs cases in so many processes (`jobs`) and yields what `run_case` gives, in the order in which they end."""
    if jobs == 1:
        for case in cases:
            yield run_case(case, device, keep)
        return
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn")) as pool:
        for done in as_completed([pool.submit(run_case, case, device, keep) for case in cases]):
            yield done.result()


def write(out: Path, scenes: Sequence[str], device: str, jobs: int, keep: Path | None) -> int:
    """Runs all cases of these scenes and writes the file; exit status 1 when one failed."""
    cases = list(product(scenes, PRESETS, INTERPOLATORS))
    if keep is not None:
        keep.mkdir(parents=True, exist_ok=True)
    found: dict[str, Any] = {}
    failures: dict[str, str] = {}
    with tqdm(total=len(cases), disable=not sys.stderr.isatty(), leave=False) as bar:
        for case, rows, failure in run_all(cases, device, jobs, keep):
            found |= rows
            if failure:
                failures["/".join(case)] = failure
            bar.update()
    about = {"size": [WIDTH, HEIGHT], "duration_s": DURATION_S, "seed": SEED, "device": device, "machine": machine()}
    folder = os.path.relpath(keep, out.parent) if keep is not None else None
    result = {"about": about, "events": folder, "cases": dict(sorted(found.items())), "failures": failures}
    out.write_text(json.dumps(result, indent=1) + "\n")
    for name, why in failures.items():
        print(f"{name} failed: {why}", file=sys.stderr)
    print(f"{out}: {len(cases)} cases, {sum(row['events'] for row in found.values()):,} events")
    return 1 if failures else 0


def compare(old: Path, new: Path, scenes: Sequence[str]) -> int:
    """Prints a line per row of these scenes; exit status 1 when one differs or is in one file only."""
    counts = {"equal": 0, "different": 0, "missing": 0}
    for name, verdict, text in differences(old, new, scenes):
        counts[verdict] += 1
        print(f"{verdict:<10} {name:<44} {text}")
    print(", ".join(f"{n} {verdict}" for verdict, n in counts.items()))
    return 0 if counts["equal"] and not counts["different"] and not counts["missing"] else 1


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command line: write a file of hashes, or compare two."""
    parser = command.parser_of("bench.event_hashes", __doc__ or "")
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--out", type=Path, metavar="FILE", help="run the cases and write this JSON file")
    what.add_argument("--compare", nargs=2, type=Path, metavar=("OLD", "NEW"), help="compare two such files")
    parser.add_argument("--scenes", metavar="NAME,...", help="of these scenes alone; all when not given")
    parser.add_argument("--device", help="where kernels run: cpu (when not given), cuda, cuda:1")
    parser.add_argument("--jobs", type=int, metavar="N", help="cases at the same time, each in a process; 1")
    parser.add_argument("--events", type=Path, metavar="DIR", help="keep the events of every case here, as .npz")
    args = parser.parse_args(argv)
    known = paths.names("scenes")
    scenes = args.scenes.split(",") if args.scenes else known
    if strange := [name for name in scenes if name not in known]:
        parser.error(f"no scene '{strange[0]}'; there are {', '.join(known)}")
    if args.compare:
        if args.device or args.jobs or args.events:
            parser.error("--device, --jobs and --events go with --out")
        old, new = args.compare
        try:
            return compare(old, new, scenes)
        except (ValueError, OSError) as error:
            print(f"{parser.prog}: {error}", file=sys.stderr)
            return 1
    if args.jobs is not None and args.jobs < 1:
        parser.error(f"--jobs is {args.jobs}; it must be 1 or more")
    command.check_file(parser, "--out", args.out)
    command.check_device(parser, args.device or "cpu")
    return write(args.out, scenes, args.device or "cpu", args.jobs or 1, args.events)


if __name__ == "__main__":
    sys.exit(main())
