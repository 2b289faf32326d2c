"""Holds the boxes about instances where their bodies are, in float64 on the host."""

from __future__ import annotations

import numpy as np

from evis.geometry import se3
from nodes.renderer.raster.visibility import Visibility
from nodes.renderer.shadows.boxes import half_extents


class BodyBoxes:
    """Holds boxes of J instances: body int64 [J], -1 for the world's own; translation [J, 3] and rotation [J, 3, 3],
    where on it; half [J, 3], half their sides [m]."""

    def __init__(self, visibility: Visibility, instances: np.ndarray) -> None:
        """Takes the instances, int64 [J]."""
        geometry = visibility.geometry
        self.body, self.translation = geometry.body[instances], geometry.translation[instances]
        self.half = half_extents(visibility)[instances]
        self.rotation = geometry.rotation[instances]
        self._stood = np.zeros((0, 0, 7))
        self._axes, self._middle = np.zeros((0, 0, 3, 3)), np.zeros((0, 0, 3))

    def place(self, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gives the middles [E, J, 3] m and axes [E, J, 3, 3] of the boxes in the world, for poses [E, N, 7]; they stay
        the same arrays while nothing moves."""
        world = np.broadcast_to(se3.IDENTITY, (len(poses), 1, 7))
        stand = np.concatenate([poses, world], axis=1)[:, self.body]
        if not np.array_equal(stand, self._stood):
            turn = se3.to_matrix(stand[..., 3:])
            self._stood, self._axes = stand, turn @ self.rotation
            self._middle = stand[..., :3] + np.einsum("enij,nj->eni", turn, self.translation)
        return self._middle, self._axes

    def sides(self, poses: np.ndarray, eye: np.ndarray) -> np.ndarray:
        """Gives how far the nearest side of each box is from `eye` [E, 3], float64 [E, J] m, for poses [E, N, 7]."""
        middle, axes = self.place(poses)
        off = (eye[:, None] - middle)[..., None, :] @ axes
        at = np.abs(off[..., 0, :]) - self.half
        outside = np.linalg.norm(np.maximum(at, 0.0), axis=-1)
        return outside + np.maximum(-at.max(axis=-1), 0.0)
