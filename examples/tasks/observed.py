"""Defines observations of few numbers, from which a small policy learns in minutes."""

from __future__ import annotations

import numpy as np
from gymnasium.spaces import Box

import evis.env
from evis.env.observations import Moment, Setting


class Centroids(evis.env.Observation):
    """Shows where events are in bands of rows, as a few numbers, float32 [bands, 3].

    Of each band the mean column of OFF and of ON events, from -1 to 1, and how many there were. Older events count less
    by exp(-steps / fade), so where a band is quiet its columns stay as they were.
    """

    def __init__(self, bands: int = 8, fade: float = 1.0) -> None:
        self.bands, self.keep = bands, float(np.exp(-1 / fade))

    def begin(self, setting: Setting) -> Box:
        """Implements Observation.begin."""
        self.size = setting.height, setting.width
        self.sums = np.zeros((setting.envs, self.bands, 2, 2))
        """Counts and summed columns of OFF and ON."""
        return Box(-np.inf, np.inf, (self.bands, 3), np.float32)

    def forget(self, envs: np.ndarray) -> None:
        """Implements Observation.forget."""
        self.sums[envs] = 0

    def values(self, moment: Moment) -> np.ndarray:
        """Implements Observation.values."""
        events, (height, width) = moment.step.events, self.size
        env = np.repeat(np.arange(len(self.sums)), np.diff(events.env_offsets))
        cell = (env * self.bands + events.y.astype(np.int64) * self.bands // height) * 2 + (events.p > 0)
        column = 2.0 * events.x / (width - 1) - 1
        fresh = np.stack([np.bincount(cell, w, self.sums.size // 2) for w in (None, column)], axis=-1)
        fresh = fresh.reshape(self.sums.shape)
        self.sums = np.where(moment.fresh[:, None, None, None], self.sums * self.keep + fresh, self.sums)
        mean = self.sums[..., 1] / np.maximum(self.sums[..., 0], 1e-9)
        count = np.log1p(fresh[..., 0].sum(axis=-1, keepdims=True))
        return np.concatenate((mean, count), axis=-1).astype(np.float32)


class Mover(evis.env.Observation):
    """Shows where something bright moves, float32 [6].

    Of the pixels that grew brighter (where it has come) and those that grew darker (where it was), the mean column and
    row from -1 to 1, as they were last seen; for both, whether they were seen in this step.
    """

    def __init__(self, least: int, bottom: float = 1.0) -> None:
        """least: events of one sign beyond those of the other that a pixel must have. bottom: rows that are looked at,
        as a share of the image.
        """
        self.least, self.bottom = least, bottom

    def begin(self, setting: Setting) -> Box:
        """Implements Observation.begin."""
        self.size = setting.height, setting.width
        self.rows = round(self.bottom * setting.height)
        self.places = np.zeros((setting.envs, 2, 2))
        """Column and row of the brighter and of the darker."""
        return Box(-np.inf, np.inf, (6,), np.float32)

    def forget(self, envs: np.ndarray) -> None:
        """Implements Observation.forget."""
        self.places[envs] = 0

    def values(self, moment: Moment) -> np.ndarray:
        """Implements Observation.values."""
        events, (height, width), envs = moment.step.events, self.size, len(self.places)
        env = np.repeat(np.arange(envs), np.diff(events.env_offsets))
        pixel = (env * height + events.y) * width + events.x
        net = np.bincount(pixel, np.where(events.p > 0, 1.0, -1.0), envs * height * width)
        net = net.reshape(envs, height, width)[:, : self.rows]
        seen = np.zeros((envs, 2))
        for sign, changed in enumerate((net >= self.least, net <= -self.least)):
            env, row, column = np.nonzero(changed)
            count = np.bincount(env, minlength=envs)
            for axis, (place, most) in enumerate(((column, width), (row, height))):
                mean = np.bincount(env, 2.0 * place / (most - 1) - 1, envs) / np.maximum(count, 1)
                self.places[:, sign, axis] = np.where(count, mean, self.places[:, sign, axis])
            seen[:, sign] = count > 0
        return np.concatenate((self.places.reshape(envs, 4), seen), axis=1).astype(np.float32)
