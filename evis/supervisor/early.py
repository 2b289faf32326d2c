"""Starts the process of a graph that takes longest to get ready while the graph is still being planned.

What such a process does first, Python's imports and the start of Warp, is the same for every plan, and takes as long as
the planning. It waits for the plan until its standard input is closed, and ends where none is there by then.
"""

from __future__ import annotations

import contextlib
import subprocess

from evis.supervisor.node_process import start_process
from evis.supervisor.run_directory import RunDirectory


class EarlyStart:
    """Holds a run's directory and one process in it, until a supervisor takes both."""

    def __init__(self, name: str) -> None:
        """Starts the process `name`, which computes with Warp. Raises OSError where a run's directory cannot be
        made."""
        self._name = name
        self._directory: RunDirectory | None = RunDirectory()
        self._process: subprocess.Popen[bytes] | None = None
        try:
            self._process = start_process(self._directory.path, name, waits=True)
        except OSError:
            self.close()
            raise

    def directory(self) -> RunDirectory:
        """Hands over the run's directory."""
        found, self._directory = self._directory, None
        assert found is not None
        return found

    def process(self, name: str) -> subprocess.Popen[bytes] | None:
        """Hands over the process, where it has this name and runs, and tells it that its plan is there."""
        process = self._process
        if process is None or name != self._name or process.poll() is not None:
            return None
        self._process = None
        assert process.stdin is not None
        process.stdin.close()
        return process

    def close(self) -> None:
        """Ends the process and the directory, where no supervisor has taken them."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            assert self._process.stdin is not None
            self._process.stdin.close()
            self._process = None
        if self._directory is not None:
            self._directory.close()
            self._directory = None


def early_start(name: str) -> EarlyStart | None:
    """Starts a process early; None where there is no room, which is reported when the other processes start."""
    with contextlib.suppress(OSError):
        return EarlyStart(name)
    return None
