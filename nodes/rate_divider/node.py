"""Runs the rate divider as a node: /state in, the states of one camera's own keyframes out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from evis.config.params import Param
from evis.runtime.clock import times_slower
from evis.runtime.node import Input, Node, Output
from msgs.header import Message
from msgs.world import WorldState
from nodes.rate_divider.merger import Merger


class RateDividerNode(Node):
    """Publishes one state per keyframe of a camera whose rate is a whole fraction of the rate of the states.

    Keyframe k of an episode is at its state k n, n = keyframe_rate / rate, and holds the sub-steps of all n.
    """

    PARAMS: ClassVar[Mapping[str, Param]] = {
        "camera": Param(str, "cam0", "camera with a rate of its own"),
        "keyframe_rate": Param(float, 30.0, "rate of /state", "Hz", 1e-3, 1e6),
        "rate": Param(float, 30.0, "the camera's keyframes per second, keyframe_rate or a whole fraction of it", "Hz",
                      1e-6, 1e6),
    }  # fmt: skip
    INPUTS: ClassVar[Mapping[str, Input]] = {"states": Input("/state")}
    OUTPUTS: ClassVar[Mapping[str, Output]] = {"state": Output("/{camera}/state")}

    @classmethod
    def divides(cls, params: Mapping[str, Any]) -> int:
        """Counts the states to each that is published. Raises ValueError for rates that do not go together."""
        return times_slower(params["keyframe_rate"], params["rate"])

    def setup(self) -> None:
        """Makes the merger for these rates."""
        self._merger = Merger(self.divides(self.params))

    def rewind(self, params: Mapping[str, Any]) -> bool:
        """Makes the merger anew."""
        if dict(params) != self.params:
            return False
        self.setup()
        return True

    def state(self) -> None:
        """Gives nothing: who goes on gives it all states again since the camera's last keyframe (`divides`)."""

    def update(self, inputs: Mapping[str, Message]) -> None:
        """Publishes a state where a keyframe of the camera is due."""
        state = inputs["states"]
        assert isinstance(state, WorldState)
        gaps, unfinished = self._merger.gaps, self._merger.unfinished
        merged = self._merger.push(state, self._allocate)
        for name, amount in (
            ("state_gaps", self._merger.gaps - gaps),
            ("unfinished_states", self._merger.unfinished - unfinished),
        ):
            if amount:
                self.count(name, amount)
        if merged is not None:
            self.publish("state", merged)

    def _allocate(self, **arrays: tuple[tuple[int, ...], Any]) -> Mapping[str, np.ndarray]:
        return self.loan("state", **arrays)
