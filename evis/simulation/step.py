"""Holds the outputs of one step that were asked for, of every camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from evis.simulation.output_names import how_to_get
from msgs.audit import Audit
from msgs.camera import (
    CameraInfo,
    Depth,
    EventPacket,
    Frames,
    Ids,
    Image,
    Imu,
    Keyframe,
    Labels,
    Motion,
    Normal,
    Samples,
)
from msgs.header import Message
from msgs.physics_error import PhysicsError
from msgs.world import WorldState

IMAGE, IMAGES = "image", "images"
"""The last image of a step, and all of them: a frame sensor has a rate of its own."""
HOLDS_ONE = {Keyframe: "image", Depth: "depth", Motion: "motion", Ids: "ids", Normal: "normal"}
"""Messages that hold one image, which is what a caller gets, without margin."""


class CameraOutputs:
    """Holds the outputs of one camera that were asked for; None where nothing came at this stamp.

    An output that was not asked for raises AttributeError. Arrays are numpy's, or Warp's on a GPU, and the caller's
    own: they stay as they are.
    """

    events: EventPacket | None
    """t, x, y, p of the interval that ends here; environment e has [env_offsets[e], env_offsets[e + 1])."""
    frames: Frames | None
    """luminance [E, K, H, W] at the K times `t`."""
    samples: Samples | None
    """The same, and between these times further samples of single pixels; with time_tolerance."""
    keyframe: Any
    """Linear radiance [E, H, W, 3]."""
    depth: Any
    """[E, H, W] m, +inf = sky."""
    motion: Any
    """Backward motion [E, H, W, 2] px."""
    ids: Any
    """Instance ids [E, H, W], 0 = background."""
    normal: Any
    """Surface normals [E, H, W, 3]."""
    labels: Labels | None
    imu: Imu | None
    audit: Audit | None
    info: CameraInfo | None
    image: Image | None
    """The last of `images`."""
    images: tuple[Image, ...]
    """Images whose exposure has ended in this interval, by their stamps and then by environment (`env`)."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        vars(self).update(values)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        raise AttributeError(f"the step has no {name}; {how_to_get(name, list(vars(self)))}")


class Step(CameraOutputs):
    """Holds the outputs of a step: those of the first camera as attributes, those of all in `cameras`.

    stamp_ns: the simulated time [ns] that it ends at. episodes: int32 [E], number of the reset that each environment is
    in. over: no step follows, as behind the end of a bag; `finish` brings what nodes still hold back. finished: it did.
    """

    state: WorldState | None
    """Poses and twists of the bodies over the interval that ends here."""
    physics_error: PhysicsError | None
    """How far the bodies of an engine were off over the run, with `finish`; None in every step before."""

    def __init__(
        self,
        stamp_ns: int,
        episodes: np.ndarray,
        cameras: Mapping[str, Mapping[str, Any]],
        others: Mapping[str, Any],
        over: bool,
        finished: bool = False,
    ) -> None:
        """Takes what one step has made. cameras: camera -> output -> value, the first one first. others: outputs of no
        camera. finished: it is what `finish` brought."""
        self.stamp_ns = stamp_ns
        self.episodes = episodes
        self.over = over
        self.finished = finished
        self.cameras = {name: CameraOutputs(values) for name, values in cameras.items()}
        first: Mapping[str, Any] = next(iter(cameras.values()), {})
        super().__init__({**first, **others})

    def __repr__(self) -> str:
        events = vars(self).get("events")
        count = f", {len(events.t)} events" if events is not None and events.t is not None else ""
        return f"Step({self.stamp_ns * 1e-9:g} s{count})"


def value_of(message: Message | None) -> Any:
    """Returns what the caller gets of a message: its image without margin where it holds one, else itself."""
    field = HOLDS_ONE.get(type(message))  # type: ignore[arg-type]
    if message is None or field is None:
        return message
    image, margin = getattr(message, field), getattr(message, "margin", 0)
    return image[:, margin : image.shape[1] - margin, margin : image.shape[2] - margin] if margin else image


M = TypeVar("M", bound=Message)


def on_host(message: M) -> M:
    """Copies a message to the host, where it has arrays elsewhere: the same with numpy arrays."""
    given = {name: value.numpy() for name, value in message.arrays().items() if not isinstance(value, np.ndarray)}
    whole: Any = message
    on_this: M = replace(whole, **given) if given else whole
    return on_this
