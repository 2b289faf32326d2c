"""Implements `evis doctor --warm`, which compiles the kernels of what usually runs, so that a first run does not wait
for them.

Kernels are made for the features that a run asks for. So every scene that comes with evis is run for a moment as
`evis launch` runs it, and the first one again with what changes kernels: other sensors, methods, labels. What Warp has
compiled stays in its cache, for all programs of the user and for as long as neither evis nor Warp is another version.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

from evis.config import paths

FIRST = "spinning_disk"
"""Run alone, for the kernels that all others have too."""
MOMENT_S = 0.07
"""Three keyframes: sub-frames, their events, and what is reached only from the second gap on [s]."""
VARIED = (
    ("interpolator:=splat",),
    ("upsampling:=1",),
    ("time_tolerance:=0.0001",),
    ("colour:=true",),
    ("envs:=2",),
    ("image:=true",),
    ("labels:=flow,depth,segmentation,boxes,boxes3d,forward_flow,backward_flow,events",),
)
"""Arguments of further runs of the first scene."""
ON_ONE_GPU = 8
"""Runs that share a GPU's memory at most."""


def runs() -> list[tuple[str, ...]]:
    """Lists what is run, each a scene and its arguments; the first is to be run before the others."""
    from nodes.event_sensor.presets import PRESETS

    sensors = [(FIRST, f"preset:={name}") for name in PRESETS if name != "ideal"]
    others = [(name,) for name in paths.names("scenes") if name != FIRST]
    return [(FIRST,), *others, *((FIRST, *arguments) for arguments in VARIED), *sensors]


def warm(
    device: str, wanted: Sequence[tuple[str, ...]], said: Callable[[str], None] = lambda line: None
) -> dict[str, str]:
    """Runs each for a moment, several at once, and returns why some failed: the run's words -> its last line.

    said: is told of each run that has ended.
    """
    cores = len(os.sched_getaffinity(0))
    at_once = cores if device == "cpu" else min(cores, ON_ONE_GPU)
    failed: dict[str, str] = {}
    with tempfile.TemporaryDirectory(prefix="evis-warm-") as folder:
        for number, (words, error) in enumerate(_each(device, wanted, Path(folder), at_once), 1):
            name = " ".join(words)
            said(f"{number}/{len(wanted)} {name}{f': {error}' if error else ''}")
            if error:
                failed[name] = error
    return failed


def _each(
    device: str, wanted: Sequence[tuple[str, ...]], folder: Path, at_once: int
) -> Iterator[tuple[tuple[str, ...], str]]:
    """Yields each run with why it failed, "" where it did not."""
    first, *others = wanted
    yield first, _run(device, first, folder / "0.mcap")
    pool = ThreadPoolExecutor(at_once)
    try:
        begun = {pool.submit(_run, device, words, folder / f"{n}.mcap"): words for n, words in enumerate(others, 1)}
        for done in as_completed(begun):
            yield begun[done], done.result()
    finally:
        pool.shutdown(cancel_futures=True)


def _run(device: str, words: Sequence[str], bag: Path) -> str:
    # In one process it compiles what it does not share with runs beside it, and recording makes it read its labels.
    options = ["--compose", "--no-view", "--json", "--duration", str(MOMENT_S), "--record", str(bag)]
    command = [sys.executable, "-P", "-m", "evis", "launch", words[0], f"device:={device}", *words[1:], *options]
    done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    bag.unlink(missing_ok=True)
    lines = done.stderr.strip().splitlines()
    return "" if not done.returncode else lines[-1] if lines else f"ended with status {done.returncode}"
