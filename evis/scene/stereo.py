"""Finds which cameras of a scene are a stereo pair, for the projection matrix that ROS has of one."""

from __future__ import annotations

import numpy as np

from evis.geometry import se3
from evis.scene.model import Body, Camera, Scene

_TIMES_NS = np.array([0, 370_000_000, 1_130_000_000, 2_910_000_000, 7_770_000_000])
"""Instants at which two cameras must stand to each other alike; no motion of a scene has a period in all of them."""
_TOLERANCE = 1e-9
"""Of a rotation [rad] and of a distance [m]: that of chained float64 poses."""
_ROUNDING = 8 * float(np.finfo(np.float64).eps)
"""Of a distance, in parts of how far the cameras are from the world's origin: 2 nm at 1,000 km."""


def baseline(scene: Scene, camera: Camera) -> float:
    """Returns how far a camera stands to the right of the first one of its stereo rig [m]; 0 where it is no such one.

    The cameras of a rig are alike, parallel, side by side along their rows and keep their places to each other. The
    first one is the leftmost.
    """
    body = scene.bodies[scene.body_index(camera.name)]
    found = [0.0]
    for other in scene.cameras:
        if other.name != camera.name and _alike(camera, other):
            known = _places(scene.bodies[scene.body_index(other.name)], body)
            if known is not None:
                found.append(_to_the_right(*known))
    return max(found)


def _alike(a: Camera, b: Camera) -> bool:
    same = (a.width, a.height, a.distortion_model, a.distortion) == (
        b.width,
        b.height,
        b.distortion_model,
        b.distortion,
    )
    return same and bool(np.array_equal(a.k, b.k))


def _places(first: Body, second: Body) -> tuple[np.ndarray, float] | None:
    """Poses [S, 7] of the second in the frame of the first at several times, and how exact their positions are [m];
    None where physics alone knows them."""
    if first.mount is not None and second.mount is not None and first.mount[0] == second.mount[0]:
        return se3.compose(se3.inverse(first.mount[1]), second.mount[1])[None], _TOLERANCE
    if first.trajectory is None or second.trajectory is None:
        return None
    one, other = first.trajectory.pose(_TIMES_NS), second.trajectory.pose(_TIMES_NS)
    return se3.compose(se3.inverse(one), other), _TOLERANCE + _ROUNDING * float(np.abs(one[:, :3]).max())


def _to_the_right(places: np.ndarray, exact: float) -> float:
    x, across, turned = places[:, 0], places[:, 1:3], places[:, 3:6]
    parallel = np.abs(turned).max() < _TOLERANCE
    apart = max(np.abs(across).max(), np.ptp(x))
    return round(float(x[0]), 12) if x[0] > exact and parallel and apart < exact else 0.0
