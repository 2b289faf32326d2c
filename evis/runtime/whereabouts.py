"""Notes in which node a process is, where its launcher can read it also while the process answers nothing.

A node that holds Python's interpreter, or a process that was stopped, sends no message that could tell. So the number
of the node lies in a page of a file in the run's directory that the process has mapped.
"""

from __future__ import annotations

import contextlib
import mmap
from collections.abc import Sequence
from pathlib import Path

_BYTES = 2
_NOWHERE = 0
"""Number of what is no node, as the bus; those of nodes follow."""


class Whereabouts:
    """Notes in which of its nodes a process is. note: one unsigned number of 16 bits, written at every change."""

    def __init__(self, directory: str = "", process: str = "", nodes: Sequence[str] = ()) -> None:
        """Makes the page. directory: of the run, "" = nobody can look. nodes: of the process, in the plan's order."""
        self._numbers = {name: k for k, name in enumerate(nodes, _NOWHERE + 1)}
        self.note = memoryview(bytearray(_BYTES)).cast("H")
        if directory:
            with contextlib.suppress(OSError):  # without room for it failures name the process
                with open(_path(Path(directory), process), "w+b") as page:
                    page.write(bytes(_BYTES))
                    page.flush()
                    self.note = memoryview(mmap.mmap(page.fileno(), _BYTES)).cast("H")

    def number(self, node: str) -> int:
        """Returns what stands for a node."""
        return self._numbers.get(node, _NOWHERE)


def node_in(directory: Path, process: str, nodes: Sequence[str]) -> str:
    """Names the node in whose call a process is, or was at its end; "" where it is in none, or nobody knows.

    directory: of the run. nodes: as of Whereabouts.
    """
    try:
        number = memoryview(_path(directory, process).read_bytes()).cast("H")[0]
    except (OSError, TypeError, IndexError):
        return ""
    return nodes[number - 1] if _NOWHERE < number <= len(nodes) else ""


def _path(directory: Path, process: str) -> Path:
    return directory / f"{process}.at"
