"""Computes how far bodies reach, and how fast the points of their geoms move that sweep through space."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from evis.geometry import se3

_GEOM = mujoco.mjtGeom
_ENDLESS = (_GEOM.mjGEOM_PLANE, _GEOM.mjGEOM_HFIELD)


class Reach:
    """Holds the farthest points of a model's bodies.

    of_body: float64 [nbody] m, distance of a body's farthest point from its origin, 0 of one without geoms.
    """

    def __init__(self, model: Any) -> None:
        solid = [g for g in range(model.ngeom) if model.geom_type[g] not in _ENDLESS]
        self._body = np.asarray(model.geom_bodyid)[solid].astype(np.int64)
        self._place = np.asarray(model.geom_pos, np.float64).reshape(-1, 3)[solid]
        axes = np.zeros((model.ngeom, 9))
        for geom in solid:
            mujoco.mju_quat2Mat(axes[geom], model.geom_quat[geom])
        self._axis = axes.reshape(-1, 3, 3)[solid][:, :, 2]
        self._along, self._across = (np.array([_ends(model, g)[k] for g in solid]) for k in (0, 1))
        self.of_body = np.zeros(model.nbody)
        far = np.linalg.norm(self._place, axis=-1) + np.asarray(model.geom_rbound)[solid]
        np.maximum.at(self.of_body, self._body, far)

    def bound(self, twist: np.ndarray) -> float:
        """Bounds the speed [m/s] of any point: twist float64 [..., bodies without the world, 6]."""
        v, omega = (np.sqrt((twist[..., part] ** 2).sum(axis=-1)) for part in (slice(0, 3), slice(3, 6)))
        return float((v + omega * self.of_body[1:]).max(initial=0.0))

    def fastest(self, pose: np.ndarray, twist: np.ndarray) -> np.ndarray:
        """Computes how fast the farthest points of each body sweep through space, float64 [..., bodies] m/s.

        Of a ball that turns about its centre, or a shaft about its axis, nothing sweeps. pose [..., bodies without the
        world, 7], twist [..., bodies, 6].
        """
        of = self._body[self._body > 0] - 1
        mine = self._body > 0
        turn, v, omega = pose[..., of, 3:], twist[..., of, :3], twist[..., of, 3:]
        centre = v + np.cross(omega, se3.rotate(turn, self._place[mine]))
        axis = se3.rotate(turn, self._axis[mine])
        about = (omega * axis).sum(axis=-1)
        tilting = np.sqrt(np.maximum((omega**2).sum(axis=-1) - about**2, 0.0))
        speed = np.linalg.norm(centre, axis=-1) + tilting * self._along[mine] + np.abs(about) * self._across[mine]
        found = np.linalg.norm(twist[..., :3], axis=-1)
        for n, body in enumerate(of.tolist()):
            found[..., body] = np.maximum(found[..., body], speed[..., n])
        return found


def _ends(model: Any, geom: int) -> tuple[float, float]:
    """Computes how far a geom's points are from its centre where it tilts, and where it turns about its z axis [m]."""
    kind, size, bound = model.geom_type[geom], model.geom_size[geom], float(model.geom_rbound[geom])
    if kind == _GEOM.mjGEOM_SPHERE:
        return 0.0, 0.0
    if kind == _GEOM.mjGEOM_CAPSULE:
        return float(size[1]), 0.0
    if kind == _GEOM.mjGEOM_CYLINDER:
        return bound, 0.0
    return bound, bound
