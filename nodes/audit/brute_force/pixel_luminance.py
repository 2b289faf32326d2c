"""Computes pixels of several environments at many instants, as many instants at once as brute force has slots."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from evis.scene.model import Camera, Scene
from nodes.audit.brute_force.brute_force import BruteForce
from nodes.audit.brute_force.motion import Motion

SCANNED = 480
"""Pixels of a scan that are computed by one call."""


class PixelLuminance:
    """Computes the luminance of pixels by brute force. Pixel i of an environment has the number env x each + i."""

    def __init__(self, scene: Scene, camera: Camera, envs: int, each: int, motion: Motion, **how: Any) -> None:
        """envs: environments; each: pixels of each; how: options of BruteForce."""
        # Room for more pixels than are audited, so that a scan of the image takes few calls.
        self._room = max(each, -(-SCANNED // envs))
        self._force = BruteForce(scene, camera, self._room, envs, **how)
        self._envs = envs
        self._each, self._motion = each, motion
        self.looks = 0
        """Pixels times instants computed so far."""

    @property
    def nonfinite(self) -> int:
        """Gives how many samples were not finite."""
        return self._force.nonfinite

    def choose(self, pixels: np.ndarray) -> None:
        """Chooses the pixels of each environment, int64 [A, n, 2] (x, y)."""
        table = np.zeros((self._envs, self._room, 2), np.int64)
        table[:, : pixels.shape[1]] = pixels
        self._force.choose(table)

    def scan(self, pixels: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Computes luminance float32 [T, P] and instances int32 [T, P] of any pixels of the first environment.

        pixels: int64 [P, 2] (x, y). times: int64 [T] ns. The chosen pixels are lost: `choose` must be called after it.
        """
        parts = []
        for first in range(0, len(pixels), self._room):
            some = pixels[first : first + self._room]
            self.choose(np.repeat(some[None], self._envs, 0))
            which = np.tile(np.arange(len(some)), len(times))
            found = self._at(np.zeros_like(which), which, np.repeat(times, len(some)))
            parts.append([values.reshape(len(times), -1) for values in found])
        luminance, instance = (np.concatenate(part, 1) for part in zip(*parts))
        return luminance, instance

    def __call__(self, pixel: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Computes luminance float32 [Q] and instances int32 [Q] of pixel numbers int64 [Q] at times int64 [Q] ns."""
        return self._at(pixel // self._each, pixel % self._each, t)

    def _at(self, env: np.ndarray, pixel: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Does the same for environments int64 [Q] and pixels by their index within them, int64 [Q]."""
        luminance, instance = np.zeros(len(t), np.float32), np.zeros(len(t), np.int32)
        if not len(t):
            return luminance, instance
        self.looks += len(t)
        start = int(t.min())
        envs = int(env.max()) + 1
        instants, which = np.unique((t - start) * envs + env, return_inverse=True)
        times, of = instants // envs + start, instants % envs
        moved = self._motion.moved(times, of)
        self._force.rest(self._motion.rest(), self._motion.movers)
        order, slots = np.argsort(which, kind="stable"), self._force.slots
        edges = np.searchsorted(which[order], np.arange(0, len(instants) + slots, slots))
        for first, (a, b) in zip(range(0, len(instants), slots), pairwise(edges.tolist())):
            part, some = order[a:b], slice(first, first + slots)
            luminance[part], instance[part] = self._force.luminance_at(
                moved[some], times[some], which[part] - first, env[part], pixel[part]
            )
        return luminance, instance
