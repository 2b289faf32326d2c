"""Passes what the processes write on to the user."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from evis.supervisor.child import Child

_MOST = 1 << 16


class Logs:
    """Follows the log files.

    Lines that nodes say to the user (`name: text`) are passed on; with debug, every line.
    """

    def __init__(self, say: Callable[[str], None], debug: bool) -> None:
        self._say = say
        self._debug = debug
        self._offsets: dict[str, int] = {}

    def forward(self, children: Iterable[Child]) -> None:
        """Passes on the whole lines that are new in the logs."""
        for child in children:
            offset = self._offsets.get(child.name, 0)
            try:
                with open(child.log_path, "rb") as log:
                    log.seek(offset)
                    text = log.read(_MOST)
            except OSError:
                continue
            whole = text[: text.rfind(b"\n") + 1] or (text if len(text) == _MOST else b"")
            self._offsets[child.name] = offset + len(whole)
            names = tuple(f"{node.name}: " for node in child.nodes)
            for line in whole.decode(errors="replace").splitlines():
                if self._debug:
                    self._say(f"{child.name} | {line}")
                elif line.startswith(names):
                    self._say(line)
