"""Passes what the processes write on to the user."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from evis.supervisor.child import Child

_PIECE = 1 << 16
"""Most of a log that is read at once [bytes]: what a process writes is not to keep its supervisor from the others."""


class Logs:
    """Follows the log files.

    Lines that nodes say to the user (`name: text`) are passed on; with debug, every line.
    """

    def __init__(self, say: Callable[[str], None], debug: bool) -> None:
        self._say = say
        self._debug = debug
        self._offsets: dict[str, int] = {}

    def forward(self, children: Iterable[Child]) -> None:
        """Passes on the whole lines that are new in the logs, of each no more than a piece."""
        for child in children:
            self._forward_piece(child)

    def drain(self, children: Iterable[Child]) -> None:
        """Passes on all that is left when the processes have ended, a last line without an end too."""
        for child in children:
            while self._forward_piece(child, ended=True):
                pass

    def _forward_piece(self, child: Child, ended: bool = False) -> bool:
        """Passes on the next lines of a log; False where there are none."""
        offset = self._offsets.get(child.name, 0)
        try:
            with open(child.log_path, "rb") as log:
                log.seek(offset)
                piece = log.read(_PIECE)
        except OSError:
            return False
        lines = piece[: piece.rfind(b"\n") + 1]
        if not lines and (ended or len(piece) == _PIECE):
            lines = piece
        self._offsets[child.name] = offset + len(lines)
        names = tuple(f"{node.name}: " for node in child.nodes)
        for line in lines.decode(errors="replace").splitlines():
            if self._debug:
                self._say(f"{child.name} | {line}")
            elif line.startswith(names):
                self._say(line)
        return bool(lines)
