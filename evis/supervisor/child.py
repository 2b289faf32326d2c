"""Starts and signals one process of a running graph, and holds what its supervisor knows about it."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from evis.console.process_limits import cpu_time, with_remedy
from evis.console.termination import STATUS
from evis.runtime.plan import NodePlan
from evis.runtime.whereabouts import node_in
from evis.supervisor.node_process import log_path, start_process

_FROM_OUTSIDE = (
    "the signal came from outside the graph (kill, a service manager, a container that is stopped): run again"
)
_REMEDIES = {
    signal.SIGKILL: "if nobody did that by hand, the machine ran out of memory: try fewer envs, a smaller image, less "
    "upsampling",
    signal.SIGSEGV: "a crash in native code: run again with device:=cpu to tell a driver's fault from ours",
    signal.SIGBUS: "shared memory ran out: free some memory, or raise the container's limit",
    signal.SIGABRT: "a native library gave up: its last words are in the lines above",
    signal.SIGILL: "a library was built for another processor: install it again on this machine",
    signal.SIGTERM: _FROM_OUTSIDE,
    signal.SIGHUP: _FROM_OUTSIDE,
    signal.SIGINT: _FROM_OUTSIDE,
    signal.SIGQUIT: _FROM_OUTSIDE,
}

_LAST_LINES = 12
_COMPILER_FAILED = "LLVM ERROR: IO failure"
_COMPILED = "make room for compiled kernels, or set WARP_CACHE_PATH to a folder on another disk"


@dataclass
class Child:
    """Represents one process of a running graph.

    state: starting, ready, running, then done or failed.
    """

    name: str
    nodes: list[NodePlan]
    directory: Path
    service: bool = False
    state: str = "starting"
    process: subprocess.Popen[bytes] | None = None
    heard_at: float = 0.0
    busy_s: float = 0.0
    stats: dict[str, Any] = field(default_factory=dict)
    summary: dict[str, Any] = field(default_factory=dict)
    failure: tuple[str, str] | None = None
    """(node, text) as the process itself reported it."""
    respawns: int = 0
    spared: bool = False
    """It failed, and nothing depends on it."""
    mentioned: bool = False
    """The user has been told that it is slow."""
    told_in: str = ""
    """The node in which it was when it was told to end, which it leaves for that."""

    @property
    def title(self) -> str:
        """Returns the nodes of the process, for messages."""
        names = ", ".join(node.name for node in self.nodes)
        return names if len(self.nodes) == 1 and names == self.name else f"{self.name} ({names})"

    @property
    def where(self) -> str:
        """Names the one of its several nodes in which the process is, or was at its end; "" where it is in none."""
        names = [node.name for node in self.nodes]
        return (node_in(self.directory, self.name, names) or self.told_in) if len(names) > 1 else ""

    @property
    def _title_at_end(self) -> str:
        """Returns `title`, and in which of the nodes the process ended."""
        where = self.where
        return f"{self.title}, in {where}," if where else self.title

    @property
    def log_path(self) -> Path:
        """Returns the path of its standard output and error."""
        return log_path(self.directory, self.name)

    @property
    def ended(self) -> bool:
        """Tells whether the process has reported its end or its failure."""
        return self.state in ("done", "failed")

    def alive(self) -> bool:
        """Tells whether the process exists."""
        return self.process is not None and self.process.poll() is None

    @property
    def exit_status(self) -> int | None:
        """Returns the exit status of its process, below 0 the number of a signal; None while it runs."""
        return self.process.poll() if self.process is not None else None

    def start(self, process: subprocess.Popen[bytes] | None = None) -> None:
        """Starts the process, or takes one that was started early."""
        self.process = process or start_process(self.directory, self.name)
        self.state = "starting"
        self.heard_at = time.monotonic()
        # Of a process before it: this one imports first, and is silent for longer.
        self.stats, self.busy_s, self.told_in = {}, 0.0, ""

    def signal(self, number: signal.Signals) -> None:
        """Sends a signal to the process if it is there."""
        if self.process is not None and self.alive():
            self.told_in = self.where
            self.process.send_signal(number)
            if number in (signal.SIGTERM, signal.SIGINT):
                self.process.send_signal(signal.SIGCONT)

    def unannounced_exit(self) -> str:
        """Describes in one line an exit that the process did not announce."""
        code = self.process.returncode if self.process is not None else None
        if code == STATUS:
            code = -signal.SIGTERM  # it has closed its files first, see evis/console/termination.py
        if code is not None and code < 0:
            try:
                number = signal.Signals(-code)
            except ValueError:
                return f"{self._title_at_end} was ended by signal {-code}"
            # libzmq ends a process that may open no more files
            if number == signal.SIGABRT and (told := self._limit_told()):
                return f"{self._title_at_end} was ended by {number.name}: {told}"
            remedy = _REMEDIES.get(number, "its last words are in the lines above")
            if number in (signal.SIGKILL, signal.SIGXCPU) and (limit := cpu_time()):
                remedy = f"{limit}; {remedy}" if number == signal.SIGKILL else limit
            return f"{self._title_at_end} was ended by {number.name}; {remedy}"
        if told := self._limit_told():
            return f"{self._title_at_end} ended with exit status {code}: {told}"
        return f"{self._title_at_end} ended with exit status {code} and no message"

    def _limit_told(self) -> str:
        """Returns the line of its last ones that tells of a limit to which it came, with the remedy; "" for none."""
        for line in self.last_lines(_LAST_LINES):
            if _COMPILER_FAILED in line:
                return f"{line}; {_COMPILED}"
            if (told := with_remedy(line)) != line:
                return told
        return ""

    def last_lines(self, count: int) -> list[str]:
        """Returns the end of its log."""
        try:
            with open(self.log_path, "rb") as log:
                log.seek(0, os.SEEK_END)
                log.seek(max(0, log.tell() - 200 * count))
                return log.read().decode(errors="replace").splitlines()[-count:]
        except OSError:
            return []
