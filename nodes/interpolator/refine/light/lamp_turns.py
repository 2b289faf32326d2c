"""Tells how long lamps that shake, swing, circle or turn about take from one turn to the next: for so long the light
that falls on a point goes one way."""

from __future__ import annotations

import numpy as np

from evis.geometry import se3
from evis.scene.model import WORLD
from nodes.interpolator.refine.probing.body_boxes import BodyBoxes
from nodes.renderer.lights.lights import fixed_vectors
from nodes.renderer.raster.visibility import Visibility

LOOKED_AT = 256
"""Instants of a gap at which lamps are looked at, at most."""
NEAR = 0.02
"""Part of its distance from the nearest thing, times a spot's half-angle where it is one, that a lamp goes from one
turn to the next at least, or none counts: irradiance changes by four times as much there."""


class LampTurns:
    """Finds the shortest time between two turns of what moves lamps, or turns their beams."""

    def __init__(self, visibility: Visibility, movers: np.ndarray) -> None:
        """Finds the lamps that move. movers: bodies that move, int64 [M]."""
        lights, geometry = visibility.scene.lights, visibility.geometry
        places, axes, half_u, half_v = fixed_vectors(lights)
        normals = np.cross(half_u, half_v)
        # What is followed of a lamp: where it is, and whither it shines.
        tracks: list[tuple[int, np.ndarray, bool, float]] = []
        for l, light in enumerate(lights):
            if light.body == WORLD or light.body not in movers:
                continue
            wide = min(light.cone[1], 1.0) if light.kind == "spot" else 1.0
            tracks.append((light.body, places[l], light.kind != "directional", wide))
            for way in (axes[l], normals[l]):
                if way.any():
                    tracks.append((light.body, way / np.linalg.norm(way), False, wide))
        self.any = bool(tracks)
        self._body = np.array([body for body, *_ in tracks], np.int64)
        self._mover = np.searchsorted(movers, self._body)
        self._at = np.array([at for _, at, *_ in tracks]).reshape(-1, 3)
        self._placed = np.array([placed for *_, placed, _ in tracks], bool)
        self._least = NEAR * np.array([wide for *_, wide in tracks])
        others = np.flatnonzero(geometry.body != visibility.camera_body)
        self._boxes = BodyBoxes(visibility, others)

    def shortest(self, moved: np.ndarray, rest: np.ndarray) -> np.ndarray:
        """Gives that time, float64 [E] instants; inf where nothing turns about once in the gap.

        moved: poses of the movers at all instants, float64 [n, E, M, 7]. rest: of all bodies at one time, float64
        [E, N, 7].
        """
        step = max(1, -(-len(moved) // LOOKED_AT))
        poses = moved[::step][:, :, self._mover]
        poses[..., ~self._placed, :3] = 0.0
        at = se3.transform(poses, self._at)
        way = np.diff(at, axis=0)
        # A turn by half a circle is one from forth to back, however it is made.
        across = np.linalg.norm(np.cross(way[:-1], way[1:]), axis=-1)
        turns = np.arctan2(across, (way[:-1] * way[1:]).sum(axis=-1)).sum(axis=0) / np.pi
        least = self._least * np.where(self._placed, self._distance(at[0], rest), 1.0)
        about = (turns >= 1.0) & (np.linalg.norm(way, axis=-1).sum(axis=0) > least * turns)
        apart = len(way) * step / np.maximum(turns, 1.0)
        return np.where(about, apart, np.inf).min(axis=1, initial=np.inf)

    def _distance(self, at: np.ndarray, rest: np.ndarray) -> np.ndarray:
        """Gives how far places [E, J, 3] are from the nearest side of a box of what is not on the same body, float64
        [E, J] m."""
        away = np.stack([self._boxes.sides(rest, at[:, j]) for j in range(at.shape[1])], axis=1)
        return np.where(self._body[:, None] == self._boxes.body, np.inf, away).min(axis=-1, initial=np.inf)
