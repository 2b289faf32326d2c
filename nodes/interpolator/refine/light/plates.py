"""Finds how long shadows of flat moving bodies are on a point, which are narrow where the edge is turned to a lamp."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from evis.geometry import se3
from nodes.renderer.lights.lights import fixed_vectors
from nodes.renderer.raster.visibility import Visibility

FLAT = 1e-3
"""Thickness of what is flat, of its next larger side."""
SELDOM = 16
"""A shadow counts that is so narrow for one in so many of a gap's instants: what tumbles is edge-on for a moment."""


class Plates:
    """Finds the shortest time for which the shadow of something flat that moves is on a point."""

    def __init__(self, visibility: Visibility, movers: np.ndarray, which: np.ndarray, fine: np.ndarray) -> None:
        """movers: bodies that move. which: instances on them that may be flat. fine: of all instances, as of Boxes."""
        scene, geometry = visibility.scene, visibility.geometry
        sides = np.sort(fine[which], axis=1)
        which = which[(sides[:, 0] < FLAT * sides[:, 1])]
        lamps = [n for n, light in enumerate(scene.lights) if light.shadows]
        self._mover = np.searchsorted(movers, geometry.body[which])
        self._rotation, self._translation = geometry.rotation[which], geometry.translation[which]
        self._fine = fine[which]
        self._lamps = [(scene.lights[n].body, scene.lights[n].kind == "directional") for n in lamps]
        self._place = fixed_vectors(scene.lights)[0][lamps]
        self._movers = movers
        self.any = bool(len(which) and lamps)

    def shortest(self, moved: np.ndarray, rest: np.ndarray, first: np.ndarray) -> np.ndarray:
        """Computes that time for each environment, float64 [E], in instants, of what moves from some to the next ones.

        A ray from a lamp to a point stays, and a plate goes by it. In the plate's frame with half sides h, along a ray
        l and a way w, the ray meets it for 2 (h_i |l_j| + h_j |l_i|) / |w_i l_j - w_j l_i| at most, for any two axes.

        moved: poses of the movers, float64 [n, E, M, 7]. rest: of all bodies at one time, float64 [E, N, 7]. first [n]:
        those instants.
        """
        before, after = (moved[first + k][:, :, self._mover] for k in (0, 1))
        centre = se3.transform(before, self._translation)
        axes = se3.to_matrix(before[..., 3:]) @ self._rotation
        way = np.einsum("...ji,...j->...i", axes, se3.transform(after, self._translation) - centre)
        longest = np.full((len(self._lamps), *way.shape[:-1]), np.inf)
        for n, (body, far) in enumerate(self._lamps):
            ray = self._ray(n, body, far, moved[first], rest, centre)
            ray = np.einsum("...ji,...j->...i", axes, ray)
            for i, j in combinations(range(3), 2):
                reach = self._fine[:, i] * abs(ray[..., j]) + self._fine[:, j] * abs(ray[..., i])
                over = abs(way[..., i] * ray[..., j] - way[..., j] * ray[..., i])
                time = np.divide(2.0 * reach, over, out=np.full(over.shape, np.inf), where=over > 0)
                longest[n] = np.minimum(longest[n], time)
            # A plate does not go by a lamp that it carries.
            longest[n][..., self._movers[self._mover] == body] = np.inf
        seldom = len(first) // SELDOM
        return np.partition(longest, seldom, axis=1)[:, seldom].min(axis=(0, 2))

    def _ray(self, n: int, body: int, far: bool, moved: np.ndarray, rest: np.ndarray, centre: np.ndarray) -> np.ndarray:
        """Gives the ways from the plates to a lamp, float64 [n, E, J, 3]."""
        at = np.broadcast_to(se3.IDENTITY, (1, 1, 7))
        if body in self._movers:
            at = moved[:, :, int(np.searchsorted(self._movers, body))]
        elif body >= 0:
            at = rest[None, :, body]
        if far:
            return np.broadcast_to(se3.rotate(at[..., 3:], self._place[n])[:, :, None], centre.shape)
        return se3.transform(at, self._place[n])[:, :, None] - centre
