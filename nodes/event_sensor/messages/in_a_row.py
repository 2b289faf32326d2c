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
        fits: tells whether the sensor takes images at times int64 [K] ns in one call; it takes fewer of them too.
    """
    rows: list[list[Any]] = []
    begun, before = True, None
    for message in messages:
        begins, form = not np.array_equal(message.episodes, episodes), _form(message)
        if begun or begins or form is None or form != before:
            rows.append([message])
        else:
            rows[-1].append(message)
        begun, episodes, before = begins, message.episodes, form
    return [run for row in rows for run in _fitting(row, fits)]


def _fitting(messages: list[Any], fits: Callable[[np.ndarray], bool]) -> list[list[Any]]:
    """Splits messages that go together into runs as long as fit, and single ones where not even two do."""
    times = [stamps(message) for message in messages]
    if len(messages) == 1 or fits(np.concatenate(times)):
        return [messages]
    found, first = [messages[:1]], 0
    for k in range(1, len(messages)):
        if fits(np.concatenate(times[first : k + 1])):
            found[-1].append(messages[k])
        else:
            found.append([messages[k]])
            first = k
    return found


def _form(message: Any) -> Any:
    """Gives what messages must have in common for their images to be in one array; None where they can never be."""
    if not isinstance(message, Frames | Samples | Keyframe) or message.own is not None or len(message.episodes) != 1:
        return None
    arrays = [(name, a.shape, type(a)) for name, a in message.arrays().items() if name not in OF_SINGLE]
    return type(message), message.header.episode, arrays
