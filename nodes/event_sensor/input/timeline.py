"""Keeps where a sensor is in time, and checks that what it is given follows."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from nodes.event_sensor.input.batch import Size
from nodes.event_sensor.input.limit import MOST_NUMBERED

LATEST = 5 * 10**18
"""Stamps lie within this of 0 [ns], 158 years, so that waiting times can be added to them."""


class Timeline:
    """Keeps the numbers of the environments' episodes, int32 [E], and the stamp of the last frame [ns].

    episodes: None before the first frame. going_on: what `fresh` gives where no episode begins.
    """

    def __init__(self, size: Size) -> None:
        self._size = size
        self.episodes: np.ndarray | None = None
        self.going_on = np.zeros(size.envs, bool)
        self.last_stamp = 0

    def state(self) -> dict[str, Any]:
        """Gives where the sensor is in time, as plain values."""
        begun = {} if self.episodes is None else {"episodes": np.array(self.episodes)}
        return {"last_stamp": self.last_stamp, **begun}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restores what `state` gave."""
        self.last_stamp = int(state["last_stamp"])
        self.episodes = np.array(state["episodes"], np.int32) if "episodes" in state else None

    def fresh(self, shape: tuple[int, ...], t: np.ndarray, episodes: np.ndarray) -> np.ndarray:
        """Tells which environments begin an episode with the first frame of a message, bool [E].

        Args:
            shape: of the message's luminance.
            t: int64 [K] ns, its stamps.
            episodes: int32 [E], its episodes.

        Raises ValueError for a message that does not fit the sensor or does not follow the last one.
        """
        size = self._size
        expected = (size.envs, len(t), size.height, size.width) + ((3,) if size.channels == 3 else ())
        if shape != expected or len(t) == 0:
            raise ValueError(f"event sensor got luminance {tuple(shape)} with {len(t)} stamps, expected {expected}")
        if math.prod(shape) > MOST_NUMBERED:
            raise ValueError(f"event sensor got {tuple(shape)} samples in one message, 2^31 are too many")
        if episodes.shape != (size.envs,):
            raise ValueError(f"event sensor got episodes of shape {episodes.shape}, expected ({size.envs},)")
        if len(t) > 1 and (t[1:] <= t[:-1]).any():
            i = int(np.argmax(t[1:] <= t[:-1])) + 1
            raise ValueError(
                f"event sensor got stamps that do not ascend: frame {i} is at {t[i]} ns after {t[i - 1]} ns"
            )
        if not (-LATEST <= t[0] and t[-1] <= LATEST):
            raise ValueError(f"event sensor got stamps from {t[0]} to {t[-1]} ns; they must lie within +-{LATEST} ns")
        if self.episodes is None:
            return np.ones(size.envs, bool)
        # Mostly no episode begins: no arithmetic for that.
        same = episodes.tobytes() == self.episodes.tobytes()
        fresh = self.going_on if same else episodes != self.episodes
        if (same or not fresh.all()) and t[0] <= self.last_stamp:
            raise ValueError(f"event sensor got a frame at {t[0]} ns after one at {self.last_stamp} ns of the episode")
        return fresh

    def follow(self, fresh: np.ndarray, t: np.ndarray, episodes: np.ndarray) -> np.ndarray:
        """Moves on to the end of a message that was found `fresh`; returns its episodes, which no caller changes."""
        if self.episodes is None or fresh is not self.going_on:
            self.episodes = episodes.copy()
        self.last_stamp = int(t[-1])
        return self.episodes
