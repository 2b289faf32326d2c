"""Computes oriented boxes of instances: of each mesh in its body's frame, so that a box turns with its body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from evis.geometry import se3
from evis.scene.model import WORLD, Scene


@dataclass
class Boxes3D:
    """Holds C boxes, by environment and then id: env, id int32 [C]; size float64 [C, 3] m, whole lengths; pose float64
    [C, 7] of the centre in the world and in_camera float64 [C, 7] in the camera's frame."""

    env: np.ndarray
    id: np.ndarray
    size: np.ndarray
    pose: np.ndarray
    in_camera: np.ndarray


class OrientedBoxes:
    """Measures the meshes once; a call places their boxes."""

    def __init__(self, scene: Scene, camera: str) -> None:
        """Takes the meshes of a scene. camera: its name."""
        self._camera = scene.body_index(camera)
        rows = [(n, i.body, *_corners(i.mesh.vertices, i.pose)) for n, i in enumerate(scene.instances, 1)]
        rows = [row for row in rows if np.isfinite(row[2]).all()]
        self._id, self._body = np.array([r[0] for r in rows], np.int32), np.array([r[1] for r in rows], np.int64)
        low, high = (np.array([r[k] for r in rows]).reshape(-1, 3) for k in (2, 3))
        self._size, self._centre = high - low, se3.make_pose((low + high) / 2, se3.IDENTITY[3:])

    def __call__(self, pose: np.ndarray) -> Boxes3D:
        """Gives the boxes of all instances, seen or not, for poses float64 [E, N, 7] of the bodies."""
        envs, count = len(pose), len(self._id)
        fixed = np.concatenate((pose, np.broadcast_to(se3.IDENTITY, (envs, 1, 7))), 1)
        body = np.where(self._body == WORLD, pose.shape[1], self._body)
        placed = se3.compose(fixed[:, body], self._centre)
        seen = se3.compose(se3.inverse(pose[:, self._camera])[:, None], placed)
        env = np.repeat(np.arange(envs, dtype=np.int32), count)
        return Boxes3D(
            env, np.tile(self._id, envs), np.tile(self._size, (envs, 1)), placed.reshape(-1, 7), seen.reshape(-1, 7)
        )


def _corners(vertices: np.ndarray, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Finds the least and the largest corner [3] of a mesh in its body's frame; NaN of one without vertices."""
    if not len(vertices):
        return np.full(3, np.nan), np.full(3, np.nan)
    points = se3.transform(pose, np.asarray(vertices, np.float64))
    return points.min(0), points.max(0)
