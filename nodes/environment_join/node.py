"""Joins shares of the environments: their messages in, one message of all environments out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from evis.config.params import Param
from evis.runtime.node import Input, Node, Output
from evis.shares.bounds import MOST, bounds
from evis.shares.joined import complete, join, join_infos
from msgs.camera import CameraInfo
from msgs.header import Message
from nodes.environment_join.alignment import Alignment


class EnvironmentJoinNode(Node):
    """Publishes one message of all environments when every share has sent its own."""

    PARAMS: ClassVar[Mapping[str, Param]] = {
        "topic": Param(str, "cam0/events", "topic whose messages are joined, without its leading slash"),
        "shares": Param(int, 2, "how many shares there are", "", 1, MOST),
        "envs": Param(int, 2, "environments of all shares", "", 1, 65536),
    }
    INPUTS: ClassVar[Mapping[str, Input]] = {
        f"share{k}": Input(f"/share{k}/{{topic}}", join=False) for k in range(MOST)
    }
    OUTPUTS: ClassVar[Mapping[str, Output]] = {"whole": Output("/{topic}")}

    @classmethod
    def needs(cls, params: Mapping[str, Any], wanted: frozenset[str]) -> frozenset[str]:
        """Needs one input for each share."""
        return frozenset(f"share{k}" for k in range(params["shares"]))

    def setup(self) -> None:
        """Prepares a queue for each share."""
        shares = self.params["shares"]
        self._envs = bounds(self.params["envs"], shares)
        self._alignment = Alignment(shares)
        self._infos: list[CameraInfo | None] = [None] * shares

    def receive(self, port: str, message: Message) -> None:
        """Takes the message of a share."""
        share = int(port.removeprefix("share"))
        if isinstance(message, CameraInfo):
            own: dict[str, Any] = {name: np.array(array) for name, array in message.arrays().items()}
            self._infos[share] = replace(message, **own)
            infos = [info for info in self._infos if info is not None]
            if len(infos) == len(self._infos):
                self.publish("whole", join_infos(infos))
            return
        message.keep()
        self._alignment.put(share, message)
        self._publish()

    def _publish(self, over: bool = False) -> None:
        lost, lacking = self._alignment.lost, 0
        for parts in self._alignment.complete(over):
            try:
                if not complete(parts):
                    lacking += sum(part is not None for part in parts)
                elif self.wants("whole"):
                    joined = join(parts, self._envs)
                    self.publish("whole", joined.written(self.loan("whole", **joined.shapes())))
            finally:
                for part in parts:
                    if part is not None:
                        part.release()
        if unmatched := self._alignment.lost - lost + lacking:
            self.count("unmatched_inputs", unmatched)

    def finish(self) -> None:
        """Publishes messages that only some shares have sent by the end."""
        self._publish(over=True)

    def close(self) -> None:
        """Releases messages that wait for those of other shares."""
        alignment: Alignment | None = getattr(self, "_alignment", None)
        if alignment is not None:
            alignment.release()
