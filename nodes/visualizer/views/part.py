"""Defines the piece that one panel gets in one bundle, and the base of all views."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from typing import Any, ClassVar

from msgs.camera import Image
from msgs.header import Header, Message


@dataclass
class PanelPart:
    """Holds what one panel gets in one bundle. `version` orders one view's parts.

    kind: `image` (JPEG or PNG, as `format` says), `events` (uint32 words) or `table` (all in `meta`).
    """

    kind: str
    version: int
    meta: dict[str, Any] = field(default_factory=dict)
    payload: bytes = b""


def header_meta(header: Header) -> dict[str, Any]:
    """Returns what the page says about a message: its time [s], sequence number and episode."""
    return {"t": header.stamp_ns / 1e9, "seq": header.seq, "episode": header.episode, "clock": header.clock}


class TopicView:
    """Shows one topic of one environment in one way, shared by all clients that have it open.

    `capture` runs on the executor's thread and copies what it needs; `render` runs on the encoding thread and returns
    the newest part, or None when there is nothing newer than version `since` (0 = the client has nothing yet).
    """

    KIND: ClassVar[str] = "table"

    def __init__(self, name: str, env: int) -> None:
        self.name = name
        self.env = env
        self.version = 0
        self._lock = threading.Lock()
        self._newest: Any = None
        self._part: PanelPart | None = None

    def pick(self, message: Message) -> Any:
        """Copies what `draw` needs of a message."""
        raise TypeError(f"{type(self).__name__} does not pick")

    def draw(self, picked: Any) -> tuple[dict[str, Any], bytes]:
        """Returns meta and payload of a part."""
        raise TypeError(f"{type(self).__name__} does not draw")

    def capture(self, message: Message) -> None:
        """Takes a message; its arrays are not used after return. An image of another environment is passed by."""
        if isinstance(message, Image) and message.env != min(self.env, message.envs - 1):
            return
        picked = self.pick(message), header_meta(message.header)
        with self._lock:
            self._newest = picked
            self.version += 1

    def render(self, since: int) -> PanelPart | None:
        """Returns the newest part, made once for all clients."""
        with self._lock:
            newest, version, part = self._newest, self.version, self._part
        if version <= since or newest is None:
            return None
        if part is None or part.version != version:
            meta, payload = self.draw(newest[0])
            part = PanelPart(self.KIND, version, {**newest[1], **meta}, payload)
            with self._lock:
                self._part = part
        return part
