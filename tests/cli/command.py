"""The command line as a user runs it: result and environment."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

NODES = Path(__file__).parents[1] / "launch"
"""Where graph_nodes.py lies, the small nodes of the launch tests."""


@dataclass
class Result:
    """Exit status and what was printed."""

    code: int
    out: str
    err: str

    @property
    def line(self) -> str:
        """The one line on stderr. Fails when there are more or none."""
        lines = [line for line in self.err.splitlines() if line]
        assert len(lines) == 1, self.err
        return lines[0]


def environment(runtime: Path) -> dict[str, str]:
    """Of a command that sees no other graph on this machine, and the code that the test itself sees."""
    path = os.pathsep.join(filter(None, (str(NODES), os.environ.get("PYTHONPATH"))))
    return {**os.environ, "XDG_RUNTIME_DIR": str(runtime), "PYTHONPATH": path}
