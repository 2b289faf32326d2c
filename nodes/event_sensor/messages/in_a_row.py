"""Finds consecutive messages of frames that a sensor may take in one call."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from msgs.camera import Frames, Keyframe, Samples

OF_SINGLE = ("first", "offset", "further", "further_rgb")
"""Arrays of the samples of single pixels between frames, whose number differs from message to message."""


def stamps(message: Any) -> np.ndarray:
    """Gives the times int64 [K] ns of the images of a message."""
    return np.array([message.header.stamp_ns]) if isinstance(message, Keyframe) else message.t


def runs(messages: Sequence[Any], episodes: np.ndarray, fits: Callable[[np.ndarray], bool]) -> list[list[Any]]:
    """Splits messages into runs whose frames a sensor may take in one call.

    Args:
        messages: in order; of one environment.
        episodes: int32 [1], of the message before. A message with which an episode begins is a run by itself.
        fits: tells whether the sensor takes images at times int64 [K] ns in one call.
    """
    found: list[list[Any]] = []
    begun = True
    for message in messages:
        begins = not np.array_equal(message.episodes, episodes)
        if begun or begins or not _alike(message, found[-1][-1]) or not fits(_times([*found[-1], message])):
            found.append([message])
        else:
            found[-1].append(message)
        begun, episodes = begins, message.episodes
    return found


def _times(messages: Sequence[Any]) -> np.ndarray:
    return np.concatenate([stamps(message) for message in messages])


def _alike(message: Any, before: Any) -> bool:
    """Tells whether the images of a message can be in one array with those of the message before."""
    if type(message) is not type(before) or not isinstance(message, Frames | Samples | Keyframe):
        return False
    if message.own is not None or before.own is not None or len(message.episodes) != 1:
        return False
    arrays = [
        {name: (a.shape, type(a)) for name, a in m.arrays().items() if name not in OF_SINGLE} for m in (message, before)
    ]
    return arrays[0] == arrays[1] and message.header.episode == before.header.episode
