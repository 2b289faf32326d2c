"""Charges the time of a node's call to that node, and names the node in errors."""

from __future__ import annotations

from typing import Any

from evis.bus import PeerLost
from evis.console.process_limits import with_remedy
from evis.console.working_folder import REMOVED, is_of_removed
from evis.runtime.profile import Profile


class NodeFailed(Exception):
    """Reports that a node raised; carries its name, and the cause as __cause__."""

    def __init__(self, node: str, error: BaseException) -> None:
        super().__init__(f"{node}: {describe(error)}")
        self.node = node


def describe(error: BaseException) -> str:
    """Describes an error in one line for a person."""
    if is_of_removed(error):
        return REMOVED
    text = with_remedy(str(error.args[0]) if isinstance(error, KeyError) and error.args else str(error))
    if isinstance(error, (ValueError, OSError, KeyError, PeerLost)) and text:
        return text
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


class NodeCall:
    """Charges the time of a block to one node, and names the node in what the block raises."""

    __slots__ = ("_name", "_profile")

    def __init__(self, profile: Profile | None, name: str) -> None:
        self._name = name
        self._profile = profile

    def __enter__(self) -> Any:
        return self._profile.enter(self._profile.node(self._name)) if self._profile else None

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        if self._profile:
            self._profile.leave()
        if isinstance(error, Exception) and not isinstance(error, (NodeFailed, PeerLost)):
            raise NodeFailed(self._name, error) from error
