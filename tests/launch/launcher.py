"""`evis launch` as a user starts it, and its children."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import psutil

HERE = Path(__file__).parent


LIMIT_S = 60.0
"""For all that is waited for: far more than a loaded machine needs, only what hangs takes it."""
PATIENT = """
import sys
from evis.supervisor import supervisor
supervisor.DRAIN_S = 1e9
from evis.cli import main
sys.exit(main())
"""


class Launcher:
    """`evis launch` in a process of its own, and its children. patient: it ends nodes by force only when asked to.

    before: a program that starts it, as nohup.
    """

    def __init__(self, path: Path, *words: str, patient: bool = False, before: Sequence[str] = ()) -> None:
        environment = {**os.environ, "PYTHONPATH": str(HERE)}
        how = ["-c", PATIENT] if patient else ["-m", "evis"]
        self.process = subprocess.Popen(
            [*before, sys.executable, *how, "launch", str(path), *words],
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
        return [p for p in found if "evis.runtime.process" in " ".join(command_of(p))]

    def child(self, name: str) -> psutil.Process:
        """The process of that name."""
        return next(p for p in self.children() if command_of(p)[-1] == name)

    def interrupt(self) -> None:
        """Ctrl-C, and wait until it has been noticed: of two that come before that, a process sees only one."""
        self.process.send_signal(signal.SIGINT)
        self.wait_for(lambda: not self._pending(signal.SIGINT))
        # Delivered; and its own loop has slept some times since, so that Python has had its turn.
        turns = self._turns()
        self.wait_for(lambda: self._turns() >= turns + 4)

    def _pending(self, number: signal.Signals) -> bool:
        """Is the signal still waiting for the process?"""
        try:
            status = Path(f"/proc/{self.process.pid}/status").read_text()
        except OSError:
            return False
        mask = next(line.split()[1] for line in status.splitlines() if line.startswith("ShdPnd:"))
        return bool(int(mask, 16) >> (number - 1) & 1)

    def _turns(self) -> float:
        """How often its main thread has gone to sleep; without end when it is gone."""
        try:
            return psutil.Process(self.process.pid).num_ctx_switches().voluntary if self._alive() else math.inf
        except psutil.NoSuchProcess:
            return math.inf

    def _alive(self) -> bool:
        return self.process.poll() is None

    def wait_for(self, condition: Callable[[], Any], timeout_s: float = LIMIT_S) -> Any:
        """Until `condition` gives something true."""
        end = time.monotonic() + timeout_s
        while time.monotonic() < end:
            self.children()
            if value := condition():
                return value
            time.sleep(0.02)
        raise AssertionError(f"nothing after {timeout_s} s; stderr: {self.stop()}")

    def end(self, timeout_s: float = LIMIT_S) -> tuple[int, str, str]:
        """Exit status, stdout, stderr."""
        out, err = self.process.communicate(timeout=timeout_s)
        return self.process.returncode, out, err

    def stop(self) -> str:
        """Kill what is left, and tell what it said."""
        if self.process.poll() is None:
            self.process.kill()
        return self.process.communicate()[1]

    def survivors(self, timeout_s: float = LIMIT_S) -> list[psutil.Process]:
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


def command_of(process: psutil.Process) -> list[str]:
    """The words that a process was started with; none where it has ended."""
    try:
        return process.cmdline()
    except psutil.Error:
        return []
