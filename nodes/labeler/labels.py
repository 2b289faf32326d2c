"""Ground truth for one camera from poses, depth and ids: pure functions of arrays."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from evis.geometry import pinhole, se3

KINDS = ("flow", "depth", "segmentation", "boxes", "poses", "velocities", "contacts")
"""What can be asked for."""


def crop(image: np.ndarray, margin: int) -> np.ndarray:
    """[E, H + 2 margin, W + 2 margin, ...] without the over-render margin, as a view."""
    return image[:, margin:-margin, margin:-margin] if margin else image


class FlowField:
    """Forward optical flow [px/s] of rigid bodies, exact at the stamp.

    A surface point X (camera frame) of body i moves relative to the camera with X' = b_i + w_i x X, where w_i is the
    body's angular velocity relative to the camera and b_i the velocity that the body, thought to go on, has at the
    camera's centre. The image velocity is the derivative of the projection, (5.16) in Ma et al., An Invitation to 3-D
    Vision; nothing is differenced.

    k: float64 [3, 3] px, of the image without margin; size: (width, height). bodies: for every id, 0 (background)
    first, the index of its body in the state, -1 for the static world. camera: index of the camera's body.
    """

    def __init__(self, k: np.ndarray, size: tuple[int, int], bodies: Sequence[int], camera: int) -> None:
        self.k = np.asarray(k, np.float64)
        self.bodies = np.asarray(bodies, np.int64)
        self.camera = camera
        rays = pinhole.unproject(self.k, pinhole.pixel_grid(*size), np.ones(size[::-1]))
        self._x, self._y = rays[..., 0], rays[..., 1]

    def motions(self, pose: np.ndarray, twist: np.ndarray) -> np.ndarray:
        """(b, w) of every id in the camera frame, float64 [ids, 6], for poses [N, 7] and twists [N, 6]."""
        centre, turn = pose[self.camera, :3], se3.conjugate(pose[self.camera, 3:])
        pose, twist = (np.concatenate((a, [still])) for a, still in ((pose, se3.IDENTITY), (twist, np.zeros(6))))
        v, omega = twist[self.bodies, :3], twist[self.bodies, 3:]
        at_camera = v + se3.cross(omega, centre - pose[self.bodies, :3])
        relative = (at_camera - twist[self.camera, :3], omega - twist[self.camera, 3:])
        return np.concatenate([se3.rotate(turn, a) for a in relative], axis=-1)

    def __call__(
        self, pose: np.ndarray, twist: np.ndarray, depth: np.ndarray, ids: np.ndarray, out: np.ndarray
    ) -> np.ndarray:
        """Write float32 [H, W, 2] for depth float32 [H, W] m and ids int32 [H, W]; NaN where depth is not finite.

        Raises ValueError for an id that has no body.
        """
        if ids.size and not 0 <= int(ids.min()) <= int(ids.max()) < len(self.bodies):
            raise ValueError(f"ids run from {ids.min()} to {ids.max()}, CameraInfo names {len(self.bodies)}")
        motions = self.motions(pose, twist)
        out[...] = np.nan
        for number in np.flatnonzero(np.bincount(ids.reshape(-1), minlength=len(motions))):
            seen = np.isfinite(depth) & (ids == number)
            if not motions[number].any():
                out[seen] = 0.0
                continue
            x, y = self._x[seen], self._y[seen]
            b, w = motions[number, :3], motions[number, 3:]
            # The projection's derivative of X = z (x, y, 1): the translation is divided by z, the rotation is not.
            scaled = b / depth[seen].astype(np.float64)[:, None]
            forward = scaled[:, 2] + w[0] * y - w[1] * x
            du = scaled[:, 0] + w[1] - w[2] * y - x * forward
            dv = scaled[:, 1] + w[2] * x - w[0] - y * forward
            out[seen, 0] = self.k[0, 0] * du + self.k[0, 1] * dv
            out[seen, 1] = self.k[1, 1] * dv
        return out


def boxes(ids: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Visible extent of every instance in ids int32 [E, H, W], the background left out.

    Returns float32 [B, 4] (x0, y0, x1, y1, inclusive pixels), int32 [B] environment and int32 [B] id, by environment
    and then id.
    """
    extent: list[tuple[int, int, int, int]] = []
    owner: list[tuple[int, int]] = []
    for env, image in enumerate(ids):
        for number in np.flatnonzero(np.bincount(image.reshape(-1))):
            if number == 0:
                continue
            seen = image == number
            rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
            extent.append((columns[0], rows[0], columns[-1], rows[-1]))
            owner.append((env, int(number)))
    box = np.array(extent, np.float32).reshape(-1, 4)
    env_id = np.array(owner, np.int32).reshape(-1, 2)
    return box, env_id[:, 0].copy(), env_id[:, 1].copy()
