"""Makes the messages of a gap from its frames and the samples between them; what a gap counts is added by its node."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from msgs.camera import Frames, Keyframe, Samples
from msgs.header import Header
from nodes.interpolator.samples import none_of

if TYPE_CHECKING:
    from nodes.interpolator.samples import Further

Made = TypeVar("Made", Frames, Samples)


def frames_of(key: Keyframe, t: np.ndarray, frames: Any, colour: bool, own_t: np.ndarray | None = None) -> Frames:
    """Makes the message of the frames up to a keyframe.

    Args:
        key: the keyframe.
        t: times of the frames, int64 [K] ns.
        frames: luminance float32 [E, K, h, w] or, with `colour`, RGB [E, K, h, w, 3]; of numpy or on a device.
        colour: what they are.
        own_t: their times in own time, int64 [E, K] ns, where the keyframe has times of its own.
    """
    return _timed(Frames(_header(key), t=t, episodes=np.array(key.episodes), **{_field(colour): frames}), key, own_t)


def samples_of(
    key: Keyframe, t: np.ndarray, frames: Any, found: Further | None, colour: bool, own_t: np.ndarray | None = None
) -> Samples:
    """Makes the message of the frames up to a keyframe with what was found between them.

    Args:
        key, t, frames, colour, own_t: as of `frames_of`.
        found: samples of single pixels, None without any.
    """
    pixels = frames.shape[0] * frames.shape[2] * frames.shape[3]
    on_device = not isinstance(frames, np.ndarray)
    first, offset, value = none_of(pixels, colour) if found is None else found.arrays(on_device)
    message = Samples(_header(key), t=t, episodes=np.array(key.episodes), first=first, offset=offset)
    setattr(message, _field(colour), frames)
    setattr(message, "further_rgb" if colour else "further", value)
    return _timed(message, key, own_t)


def _field(colour: bool) -> str:
    return "rgb" if colour else "luminance"


def _header(key: Keyframe) -> Header:
    """Makes the header of what is made of a keyframe, to be numbered anew."""
    return Header(key.header.stamp_ns, clock=key.header.clock, episode=key.header.episode)


def _timed(message: Made, key: Keyframe, own_t: np.ndarray | None) -> Made:
    """Adds what environments have of time of their own."""
    if key.own is not None:
        message.own, message.own_t = np.array(key.own), own_t
    return message
