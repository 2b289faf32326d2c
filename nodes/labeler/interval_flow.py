"""Computes where the surface points of an image are at another instant: flow over an interval, there and back.

Forward flow stands at the pixels of the interval's start and leads to its end, backward flow stands at those of the end
and leads to the start, both in px: the displacement of the surface point that the pixel's centre sees. It is known
wherever there is a surface. It is valid where the point is also in the image at the other instant, within half a pixel
of the outermost centres, and is what its place shows then: nothing nearer covers it, and its front faces the camera.
"""

from __future__ import annotations

import numpy as np

from evis.scene.model import Camera, Scene
from nodes.labeler.rays.instants import Instant, Instants
from nodes.labeler.rays.motion_kernels import Motion
from nodes.labeler.rays.ray_caster import RayCaster

KEPT = 2
"""Instants that are kept: an interval's ends, of which the later one is where the next interval begins."""


class IntervalFlow:
    """Computes flow between two instants for one camera."""

    def __init__(self, scene: Scene, camera: Camera, caster: RayCaster) -> None:
        """Takes what is seen, and what finds surfaces. caster: of the same camera."""
        self._instants = Instants(scene, camera, caster)
        self._known: list[Instant] = []

    def prepare(self, motion: Motion) -> None:
        """Compiles and loads the kernels, as a node does before the graph starts. motion: any."""
        self(motion, np.zeros(1, np.int64), 0, 0)
        self._known = []

    def __call__(self, motion: Motion, envs: np.ndarray, start: int, end: int) -> tuple[np.ndarray, np.ndarray]:
        """Computes displacements of environments int64 [E] from `start` to `end` [ns], either of which may be the
        earlier.

        Returns float32 [E, H, W, 2] px, NaN where there is no surface, and whether each is valid, uint8 [E, H, W].
        """
        return self._instants.flow(self._at(motion, envs, start), self._at(motion, envs, end))

    def _at(self, motion: Motion, envs: np.ndarray, t: int) -> Instant:
        """Finds what is where at a time; what was seen is kept as long as everything is in the same place."""
        found = self._instants.at(motion, envs, t)
        known = next((one for one in self._known if one.same(found)), found)
        self._known = [*(one for one in self._known if one is not known), known][-KEPT:]
        return known
