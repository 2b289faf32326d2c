"""Checks body poses, and gives them as matrices on the host to who wants them."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property

import numpy as np

from evis.geometry import se3

POSE_BYTES = 7 * np.dtype(np.float64).itemsize
"""Size of a pose (p, q) on the host and on devices."""


def check_poses(poses: np.ndarray, envs: int, names: list[str]) -> np.ndarray:
    """Gives `poses` as float64 [E, N, 7]. Raises ValueError naming the body and environment of the first bad one."""
    poses = check_shape(poses, envs, names)
    check_values(poses, names)
    return poses


def check_shape(poses: np.ndarray, envs: int, names: list[str]) -> np.ndarray:
    """Gives `poses` as float64 [E, N, 7], contiguous but for environments that share memory. Raises ValueError where
    they have another shape."""
    poses = np.asarray(poses, np.float64)
    if not (_shared(poses) and poses[0].flags.c_contiguous):
        poses = np.ascontiguousarray(poses)
    if poses.shape != (envs, len(names), 7):
        raise ValueError(
            f"poses have shape {poses.shape}; {envs} environment(s) of {len(names)} bodies need {(envs, len(names), 7)}"
        )
    return poses


def check_values(poses: np.ndarray, names: list[str]) -> None:
    """Raises ValueError naming the body and environment of the first pose float64 [E, N, 7] that is none."""
    if _shared(poses):
        poses = poses[:1]
    flat = poses.reshape(-1)
    with np.errstate(all="ignore"):
        # The common case, told by one pass over all numbers and one over those that are not 0 but for half turns.
        # Not by `dot`, which wakes threads that then wait in a busy loop.
        if math.isfinite(np.einsum("i,i->", flat, flat)) and np.abs(poses[..., 6]).min(initial=1.0) > 1e-100:
            return
        length = np.sqrt(np.einsum("eni,eni->en", poses[..., 3:], poses[..., 3:]))
    good = np.isfinite(poses).all(-1) & np.isfinite(length) & (length > 0.0)
    if not good.all():
        env, body = np.argwhere(~good)[0]
        whole = np.isfinite(poses[env, body]).all()
        fault = f"has a quaternion of length {length[env, body]:g}" if whole else "is not finite"
        raise ValueError(f"pose of body '{names[body]}' {fault} (environment {env}): {poses[env, body].tolist()}")


def same_bytes(a: np.ndarray, b: np.ndarray) -> bool:
    """Tells whether two float64 arrays are the same to the last bit; most often the first item tells."""
    if a.shape != b.shape:
        return False
    a, b = a.view(np.int64), b.view(np.int64)
    return np.array_equal(a[0], b[0]) and np.array_equal(a[1:], b[1:])


def of_bodies(poses: np.ndarray, bodies: np.ndarray) -> np.ndarray:
    """Gives the poses [E, n, 7] of these bodies, of poses [E, N, 7] of all; not to be written to, for environments that
    share memory do so in them too."""
    if not _shared(poses):
        return poses.take(bodies, axis=1)
    return np.broadcast_to(poses[0].take(bodies, axis=0), (len(poses), len(bodies), 7))


def _shared(poses: np.ndarray) -> bool:
    """Tells whether there are several environments, which share memory."""
    return poses.ndim == 3 and len(poses) > 1 and not poses.strides[0]


class InstancePoses:
    """Computes where everything is, seen from the camera, at one instant, in float64 on the host, when it is asked for.

    bodies: poses float64 [E, N, 7], or what gives them; index: of the camera's body; on: body of each instance int64
    [I] (-1 = world); rest: rotations float64 [I, 3, 3] and translations float64 [I, 3] of the instances in their
    bodies' frames.
    """

    def __init__(
        self,
        bodies: np.ndarray | Callable[[], np.ndarray],
        index: int,
        on: np.ndarray,
        rest: tuple[np.ndarray, np.ndarray],
    ) -> None:
        self._bodies, self._index, self._on, self._rest = bodies, index, on, rest

    @property
    def bodies(self) -> np.ndarray:
        """Gives the poses float64 [E, N, 7] of the bodies."""
        return self._bodies() if callable(self._bodies) else self._bodies

    @cached_property
    def camera(self) -> np.ndarray:
        """Gives [E, 3, 3] camera to world."""
        return se3.to_matrix(se3.normalize(self.bodies[:, self._index, 3:]))

    @cached_property
    def rotation(self) -> np.ndarray:
        """Gives [E, I, 3, 3] instance to camera."""
        return self._all[0][:, self._on] @ self._rest[0]

    @cached_property
    def translation(self) -> np.ndarray:
        """Gives [E, I, 3] instance to camera [m]."""
        turn, place = self._all
        return place[:, self._on] + (turn[:, self._on] @ self._rest[1][..., None])[..., 0]

    def of_first(self) -> InstancePoses:
        """Gives the poses of the first environment alone."""
        return InstancePoses(self.bodies[:1], self._index, self._on, self._rest)

    def body(self, index: int) -> tuple[np.ndarray, np.ndarray]:
        """Gives the rotation [E, 3, 3] and translation [E, 3] of a body (-1 = world) to the camera."""
        to_camera = np.swapaxes(self.camera, -1, -2)
        eye = self.bodies[:, self._index, :3]
        if index < 0:
            return to_camera, (to_camera @ -eye[..., None])[..., 0]
        turn = to_camera @ se3.to_matrix(se3.normalize(self.bodies[:, index, 3:]))
        return turn, (to_camera @ (self.bodies[:, index, :3] - eye)[..., None])[..., 0]

    @cached_property
    def _all(self) -> tuple[np.ndarray, np.ndarray]:
        """Gives rotations and translations of all bodies and, as the last one, of the world."""
        each = [self.body(k) for k in (*range(self.bodies.shape[1]), -1)]
        return np.stack([turn for turn, _ in each], 1), np.stack([place for _, place in each], 1)
