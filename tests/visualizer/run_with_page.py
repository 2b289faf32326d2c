"""Commands of `evis` that bring a page, started and ended by a test."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from browser_panels import LIMIT_S

EVIS = [sys.executable, "-m", "evis"]
START_S = 180
"""The first run on a machine compiles the kernels."""


def start(*words: str) -> subprocess.Popen[str]:
    """A command in a session of its own."""
    return subprocess.Popen(
        [*EVIS, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ.copy()
    )


def stop(process: subprocess.Popen[str]) -> tuple[str, str]:
    """Ctrl-C, and what was written."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    try:
        return process.communicate(timeout=LIMIT_S)
    finally:
        process.kill()


def viewer_url(runs: Path, process: subprocess.Popen[str]) -> str:
    """The address out of the run's viewer.json, once it is there."""
    deadline = time.monotonic() + START_S
    while time.monotonic() < deadline:
        assert process.poll() is None, process.communicate()
        for file in runs.glob("evis/*/viewer.json"):
            return json.loads(file.read_text())["url"]
        time.sleep(0.1)
    raise AssertionError(f"no viewer.json after {START_S} s")
