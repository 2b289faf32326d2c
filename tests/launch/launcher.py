"""`evis launch` as a user starts it, and its children."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil

HERE = Path(__file__).parent


class Launcher:
    """`evis launch` in a process of its own, and its children."""

    def __init__(self, path: Path, *words: str) -> None:
        environment = {**os.environ, "PYTHONPATH": str(HERE)}
        self.process = subprocess.Popen(
            [sys.executable, "-m", "evis.cli", "launch", str(path), *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=environment,
        )
        self.seen: list[psutil.Process] = []

    def children(self) -> list[psutil.Process]:
        """Node processes now alive."""
        try:
            found = psutil.Process(self.process.pid).children(recursive=True)
        except psutil.NoSuchProcess:
            found = []
        self.seen += [p for p in found if p not in self.seen]
        return [p for p in found if "evis.process" in " ".join(_command(p))]

    def child(self, name: str) -> psutil.Process:
        """The process of that name."""
        return next(p for p in self.children() if _command(p)[-1] == name)

    def wait_for(self, condition: Callable[[], Any], timeout_s: float = 20.0) -> Any:
        """Until `condition` gives something true."""
        end = time.monotonic() + timeout_s
        while time.monotonic() < end:
            self.children()
            if value := condition():
                return value
            time.sleep(0.02)
        raise AssertionError(f"nothing after {timeout_s} s; stderr: {self.stop()}")

    def end(self, timeout_s: float = 30.0) -> tuple[int, str, str]:
        """Exit status, stdout, stderr."""
        out, err = self.process.communicate(timeout=timeout_s)
        return self.process.returncode, out, err

    def stop(self) -> str:
        """Kill what is left, and tell what it said."""
        if self.process.poll() is None:
            self.process.kill()
        return self.process.communicate()[1]

    def survivors(self, timeout_s: float = 5.0) -> list[psutil.Process]:
        """Descendants that are still there a moment later; a zombie is dead."""
        end = time.monotonic() + timeout_s
        while (left := [p for p in self.seen if _alive(p)]) and time.monotonic() < end:
            time.sleep(0.02)
        return left


def _alive(process: psutil.Process) -> bool:
    try:
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def _command(process: psutil.Process) -> list[str]:
    try:
        return process.cmdline()
    except psutil.Error:
        return []
