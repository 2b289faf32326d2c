"""Finds for how long shadows of boxes and flat things that move, narrow at corners and edge-on, are on a point."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from evis.geometry import se3
from evis.gpu.exchange import cpu_array
from nodes.interpolator.refine.light.box_shadow_kernels import find_box_shadow_times
from nodes.interpolator.refine.probing.boxes import boxes_of
from nodes.renderer.lights.lights import fixed_vectors
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.shadows.boxes import box_halves

FLAT = 1e-3
"""Thickness of what is flat, of its next larger side."""
SELDOM = 16
"""A shadow counts that is so narrow for one part in so many of its way: what tumbles is edge-on for a moment."""
CORNERS = 1 / 14
"""Share of an outline's height, from its top and its bottom, in which its shadow may be shorter: one point in seven, as
many as of a round thing's are on less than half of its width."""


class BoxShadows:
    """Finds the shortest time for which the shadow of a box, or the light through a hole as such, that moves is on a
    point."""

    def __init__(
        self, visibility: Visibility, movers: np.ndarray, boxes: Any, share: np.ndarray, still: np.ndarray | None = None
    ) -> None:
        """Takes the boxes of what throws shadows. movers: bodies that move. boxes: on them, as of Boxes. share [J]: of
        the height of an outline at which its width counts. still: bodies that stand still before lamps that move, on
        which boxes are instead."""
        scene = visibility.scene
        lamps = [n for n, light in enumerate(scene.lights) if light.shadows]
        if still is not None:
            # A light far away is as it is for what else it passes.
            lamps = [n for n in lamps if scene.lights[n].body in movers and scene.lights[n].kind != "directional"]
        self._boxes, self._share, self._count, self._still = boxes, share, len(share), still
        self._bodies = [scene.lights[n].body for n in lamps]
        self._far = np.array([scene.lights[n].kind == "directional" for n in lamps], bool)
        self._place = fixed_vectors(scene.lights)[0][lamps]
        self._movers = movers
        self.any = bool(self._count and lamps)

    @classmethod
    def of(
        cls, visibility: Visibility, movers: np.ndarray, which: np.ndarray, fine: np.ndarray, still: bool = False
    ) -> BoxShadows:
        """Makes those of the shadows of boxes and flat things. which: instances on movers, or that stand still before
        lamps that move, that may be such. fine: of all instances, as of Boxes."""
        sides = np.sort(fine, axis=1)
        corners = np.any(box_halves(visibility) > 0, axis=1)
        flat = sides[:, 0] < FLAT * sides[:, 1]
        which = which[corners[which] | flat[which]]
        # Of what is round and flat `fine` is narrower than the most already.
        share = np.where(corners[which], CORNERS, 0.5)
        bodies = np.unique(visibility.geometry.body[which]) if still else movers
        boxes = boxes_of(visibility, bodies, which, fine)[0]
        return cls(visibility, movers, boxes, share, bodies if still else None)

    def shortest(self, moved: np.ndarray, rest: np.ndarray, first: np.ndarray) -> np.ndarray:
        """Gives that time, float64 [E] instants, from some instants to the next ones.

        moved: poses of the movers, float64 [n, E, M, 7]. rest: of all bodies at one time, float64 [E, N, 7]. first [n]:
        those instants.
        """
        rides = [int(np.searchsorted(self._movers, b)) if b in self._movers else -1 for b in self._bodies]
        at = np.stack([self._lamp(n, mover, moved[first], rest) for n, mover in enumerate(rides)])
        gone_by = np.zeros(at.shape)
        if self._still is not None:
            gone_by = np.stack([self._lamp(n, mover, moved[first + 1], rest) for n, mover in enumerate(rides)]) - at
            # The world itself is the last one.
            world = np.broadcast_to(se3.IDENTITY, (len(rest), 1, 7))
            moved = np.repeat(np.concatenate([rest, world], axis=1)[None, :, self._still], 2, axis=0)
            first, rides = np.zeros_like(first), [-1] * len(rides)
        shape = (len(rides), len(first), moved.shape[1], self._count)
        times, gone = np.empty(shape), np.empty(shape)
        far, on = self._far.astype(np.int32), np.array(rides, np.int32)
        poses = cpu_array(np.ascontiguousarray(moved), wp.transformd)
        given = [self._boxes, cpu_array(self._share), cpu_array(at, wp.vec3d), cpu_array(gone_by, wp.vec3d)]
        given += [cpu_array(far), cpu_array(on), cpu_array(first), poses]
        wp.launch(find_box_shadow_times, shape, given, [cpu_array(times), cpu_array(gone)], device="cpu")
        return _but_for(times, gone).min(axis=(0, 2))

    def _lamp(self, n: int, mover: int, moved: np.ndarray, rest: np.ndarray) -> np.ndarray:
        """Gives where a lamp is or, far away, towards where it is, float64 [n, E, 3]."""
        at = np.broadcast_to(se3.IDENTITY, (1, 1, 7))
        if mover >= 0:
            at = moved[:, :, mover]
        elif self._bodies[n] >= 0:
            at = rest[None, :, self._bodies[n]]
        place = se3.rotate(at[..., 3:], self._place[n]) if self._far[n] else se3.transform(at, self._place[n])
        return np.broadcast_to(place, (*moved.shape[:2], 3))


def _but_for(times: np.ndarray, gone: np.ndarray) -> np.ndarray:
    """Gives the time [lamps, E, J] than which shadows are longer on a point for all but one part in SELDOM of their
    way; times: from instants [lamps, n, E, J]. gone: how far a shadow comes from each of them to the next.

    A part of the way and not of the gap: what flies through the image in a tenth of a gap is edge-on within that.
    """
    order = np.argsort(times, axis=1)
    so_far = np.cumsum(np.take_along_axis(gone, order, axis=1), axis=1)
    enough = (so_far * SELDOM > so_far[:, -1:]).argmax(axis=1)
    return np.take_along_axis(np.take_along_axis(times, order, axis=1), enough[:, None], axis=1)[:, 0]
