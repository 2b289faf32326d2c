"""The interpolator node: keyframes with depth and motion in, frames at K times their rate out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from evis.node import Input, Node, Output
from evis.params import Param
from msgs.camera import Depth, Frames, Keyframe, Motion
from msgs.header import Header, Message

if TYPE_CHECKING:
    from nodes.interpolator.interpolator import Interpolator


class InterpolatorNode(Node):
    """Makes K frames of every gap between two keyframes, the last being the keyframe itself."""

    PARAMS = {
        "camera": Param(str, "cam0", "which camera of the scene"),
        "method": Param(str, "splat", "splat: warp by motion and depth; none: pass on", choices=("splat", "none")),
        "upsampling": Param(int, 8, "frames per gap (K)", minimum=1, maximum=4096),
        "device": Param(str, "cpu", "cpu, cuda or cuda:N"),
        "colour": Param(bool, False, "frames are linear RGB, for colour events, instead of luminance"),
        "threads": Param(int, 1, "CPU threads, which share the frames of a gap", minimum=1, maximum=256),
    }
    INPUTS = {
        "keyframe": Input("/{camera}/keyframe"),
        "depth": Input("/{camera}/depth"),
        "motion": Input("/{camera}/motion"),
    }
    OUTPUTS = {"frames": Output("/{camera}/frames")}
    interpolator: Interpolator

    @classmethod
    def needs(cls, params: Mapping[str, Any], wanted: frozenset[str]) -> frozenset[str]:
        """Depth and motion only for a method that warps."""
        return frozenset(cls.INPUTS) if params["method"] == "splat" else frozenset({"keyframe"})

    def setup(self) -> None:
        from nodes.interpolator.interpolator import Interpolator

        p = self.params
        self.interpolator = Interpolator(
            p["method"], p["upsampling"], colour=p["colour"], device=p["device"], threads=p["threads"]
        )
        self.interpolator.warm_up()
        self._field = "rgb" if p["colour"] else "luminance"
        self._kept: list[Message] = []

    def update(self, inputs: Mapping[str, Message]) -> None:
        key = inputs["keyframe"]
        assert isinstance(key, Keyframe)
        depth, motion = inputs.get("depth"), inputs.get("motion")
        t, frames = self.interpolator.push(
            key.header.stamp_ns,
            key.episodes,
            key.radiance,
            depth.depth if isinstance(depth, Depth) else None,
            motion.motion if isinstance(motion, Motion) else None,
            key.margin,
            self._allocate,
        )
        # The arrays of this keyframe are those of A in the next gap.
        for message in inputs.values():
            message.keep()
        self._release()
        self._kept = list(inputs.values())
        report = self.interpolator.report
        for name, amount in (("filled_pixels", report.filled), ("nonfinite_motion", report.nonfinite)):
            if amount:
                self.count(name, amount)
        header = Header(key.header.stamp_ns, clock=key.header.clock, episode=key.header.episode)
        images: dict[str, Any] = {self._field: frames}
        self.publish("frames", Frames(header, t=t, episodes=np.array(key.episodes), filled=report.filled, **images))

    def _allocate(self, shape: tuple[int, ...]) -> np.ndarray:
        return self.loan("frames", **{self._field: (shape, np.float32)})[self._field]

    def _release(self) -> None:
        for message in self._kept:
            message.release()
        self._kept = []

    def close(self) -> None:
        self._release()
