"""Cuts out a share of the environments: messages of all environments in, the same messages of one share out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

from evis.config.params import Param
from evis.runtime.node import Input, Node, Output
from evis.shares.bounds import MOST, bounds
from evis.shares.cut import cut, environments
from msgs.header import Header, Message


class EnvironmentShareNode(Node):
    """Publishes every message cut to the environments of one share."""

    PARAMS: ClassVar[Mapping[str, Param]] = {
        "topic": Param(str, "state", "topic whose messages are cut, without its leading slash"),
        "share": Param(int, 0, "which share this is", "", 0, MOST - 1),
        "shares": Param(int, 1, "how many there are", "", 1, MOST),
    }
    INPUTS: ClassVar[Mapping[str, Input]] = {"whole": Input("/{topic}")}
    OUTPUTS: ClassVar[Mapping[str, Output]] = {"part": Output("/share{share}/{topic}")}

    def rewind(self, params: Mapping[str, Any]) -> bool:
        """Keeps no state, so nothing is to be undone."""
        return dict(params) == self.params

    def update(self, inputs: Mapping[str, Message]) -> None:
        """Cuts a message to the share and publishes it."""
        message: Any = inputs["whole"]
        part = cut(message, bounds(environments(message), self.params["shares"])[self.params["share"]])
        arrays = self.loan("part", **{name: (array.shape, array.dtype) for name, array in part.items()})
        for name, array in part.items():
            arrays[name][...] = array
        header = Header(message.header.stamp_ns, clock=message.header.clock, episode=message.header.episode)
        self.publish("part", replace(message, header=header, **arrays))
