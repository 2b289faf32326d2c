"""Starts a process of a graph: `python -m evis.runtime.process`."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from evis.runtime.process.parent_death import PARENT_VARIABLE

PLAN = "plan.json"
"""File in a run's directory that its processes read."""
THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
"""One compute thread per process unless the user's environment says otherwise: more are many times slower."""


def environment_of_child() -> dict[str, str]:
    """Returns the environment of a process that runs Python as this one does, and ends with it (`die_with_parent`)."""
    environment = {**os.environ, PARENT_VARIABLE: str(os.getpid())}
    environment["PYTHONPATH"] = os.pathsep.join(os.path.abspath(path) for path in sys.path if path)
    for variable in THREAD_VARIABLES:
        environment.setdefault(variable, "1")
    return environment


def log_path(directory: Path, name: str) -> Path:
    """Returns the file of a process's standard output and error."""
    return directory / f"{name}.log"


def start_process(directory: Path, name: str, waits: bool = False) -> subprocess.Popen[bytes]:
    """Starts a process of the run in `directory`, in a session of its own. Raises OSError.

    A terminal's Ctrl-C so reaches the supervisor alone.
    """
    early = ["--early"] if waits else []
    with open(log_path(directory, name), "ab") as log:
        return subprocess.Popen(
            [sys.executable, "-P", "-m", "evis.runtime.process", *early, str(directory / PLAN), name],
            stdin=subprocess.PIPE if waits else subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            env={**environment_of_child(), "PYTHONUNBUFFERED": "1"},
        )
