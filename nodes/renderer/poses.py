"""Poses to camera-relative matrices, in float64 on the host, so that nothing is lost far from the origin."""

from __future__ import annotations

import numpy as np

from evis.geometry import se3


def check_poses(poses: np.ndarray, envs: int, names: list[str]) -> np.ndarray:
    """`poses` as float64 [E, N, 7]. Raises ValueError naming the body and environment of the first bad one."""
    poses = np.asarray(poses, np.float64)
    if poses.shape != (envs, len(names), 7):
        raise ValueError(
            f"poses have shape {poses.shape}; {envs} environment(s) of {len(names)} bodies need {(envs, len(names), 7)}"
        )
    good = np.isfinite(poses).all(-1) & (np.abs(poses[..., 3:]).max(-1) > 0)
    if not good.all():
        env, body = np.argwhere(~good)[0]
        fault = "has a quaternion of length 0" if np.isfinite(poses[env, body]).all() else "is not finite"
        raise ValueError(f"pose of body '{names[body]}' {fault} (environment {env}): {poses[env, body].tolist()}")
    return poses


class Frames:
    """Where everything is, seen from the camera, at one instant.

    bodies: poses float64 [E, N, 7]; camera: index of its body; on: body of each instance int64 [I] (-1 = world);
    rotation float64 [I, 3, 3] and translation float64 [I, 3]: the instance in its body's frame.
    Gives `rotation` [E, I, 3, 3] and `translation` [E, I, 3], instance to camera; `camera` [E, 3, 3], camera to world.
    """

    def __init__(
        self, bodies: np.ndarray, camera: int, on: np.ndarray, rotation: np.ndarray, translation: np.ndarray
    ) -> None:
        envs = len(bodies)
        self.bodies = np.array(bodies)
        turn = se3.to_matrix(se3.normalize(bodies[..., 3:]))
        self.camera = turn[:, camera]
        to_camera = np.swapaxes(self.camera, -1, -2)[:, None]
        # The world is one more body, found by the index -1. Subtracting the camera's position first keeps all digits.
        turn = np.concatenate([turn, np.broadcast_to(np.eye(3), (envs, 1, 3, 3))], 1)
        place = np.concatenate([bodies[..., :3], np.zeros((envs, 1, 3))], 1) - bodies[:, camera, None, :3]
        self._turn = to_camera @ turn
        self._place = (to_camera @ place[..., None])[..., 0]
        self.rotation = self._turn[:, on] @ rotation
        self.translation = self._place[:, on] + (self._turn[:, on] @ translation[..., None])[..., 0]

    def body(self, index: int) -> tuple[np.ndarray, np.ndarray]:
        """Rotation [E, 3, 3] and translation [E, 3] of a body (-1 = world) to the camera."""
        return self._turn[:, index], self._place[:, index]

    def same(self, other: Frames) -> bool:
        """True when every body is where it was, to the last bit."""
        return np.array_equal(self.bodies, other.bodies)

    def displacement(self, previous: Frames) -> tuple[np.ndarray, np.ndarray]:
        """D - 1 of the map D from a thing's point in this camera frame to the same point in the previous one.

        [E, I + 1, 3, 3] and [E, I + 1, 3]; entry I is the sky, which only turns. Exactly zero for what is where it was.
        """
        envs, count = self.rotation.shape[:2]
        turn, shift = np.zeros((envs, count + 1, 3, 3)), np.zeros((envs, count + 1, 3))
        back = previous.rotation @ np.swapaxes(self.rotation, -1, -2)
        turn[:, :count] = back - np.eye(3)
        shift[:, :count] = previous.translation - (back @ self.translation[..., None])[..., 0]
        turn[:, count] = np.swapaxes(previous.camera, -1, -2) @ self.camera - np.eye(3)
        still = (self.rotation == previous.rotation).all((-1, -2)) & (self.translation == previous.translation).all(-1)
        turn[:, :count][still] = 0.0
        shift[:, :count][still] = 0.0
        turn[:, count][(self.camera == previous.camera).all((-1, -2))] = 0.0
        return turn, shift
