"""Ground truth for one camera from poses, depth and ids: pure functions of arrays."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from evis.geometry import pinhole, se3
from evis.geometry.distortion import Lens, unproject

KINDS = ("flow", "depth", "segmentation", "boxes", "poses", "velocities", "contacts")
"""What can be asked for."""


def crop(image: np.ndarray, margin: int) -> np.ndarray:
    """[E, H + 2 margin, W + 2 margin, ...] without the over-render margin, as a view."""
    return image[:, margin:-margin, margin:-margin] if margin else image


def lens_of(model: str, coefficients: np.ndarray) -> Lens | None:
    """The lens that CameraInfo describes, None for a pinhole. Raises ValueError."""
    straight = model == "plumb_bob" and not np.any(coefficients)
    return None if straight or model == "none" else Lens.of(model, np.asarray(coefficients).tolist())


class FlowField:
    """Forward optical flow [px/s] of rigid bodies, exact at the stamp.

    A surface point X (camera frame) of body i moves relative to the camera with X' = b_i + w_i x X, where w_i is the
    body's angular velocity relative to the camera and b_i the velocity that the body, thought to go on, has at the
    camera's centre. The image velocity is the derivative of the projection, (5.16) in Ma et al., An Invitation to 3-D
    Vision; nothing is differenced.

    k: float64 [3, 3] px, of the image without margin; size: (width, height). bodies: for every id, 0 (background)
    first, the index of its body in the state, -1 for the static world. camera: index of the camera's body. lens: its
    distortion, None for a pinhole.
    """

    def __init__(
        self, k: np.ndarray, size: tuple[int, int], bodies: Sequence[int], camera: int, lens: Lens | None = None
    ) -> None:
        self.k = np.asarray(k, np.float64)
        self.bodies = np.asarray(bodies, np.int64)
        self.camera = camera
        pixels = pinhole.pixel_grid(*size)
        # Points on these rays have z = 1, so that depth scales them.
        if lens is None:
            self._rays = pinhole.unproject(self.k, pixels, np.ones(size[::-1]))
            x, y = self._rays[..., 0], self._rays[..., 1]
            one, none = np.ones_like(x), np.zeros_like(x)
            plane = np.stack((np.stack((one, none, -x), -1), np.stack((none, one, -y), -1)), -2)
        else:
            unit = unproject(self.k, lens, pixels)
            with np.errstate(divide="ignore", invalid="ignore"):
                self._rays = unit / unit[..., 2:]
                plane = lens.derivative(unit) * unit[..., 2, None, None]
        # d(pixel) / d(X, Y, Z) on the rays, [H, W, 2, 3]
        focal = self.k[:2, :2] if lens is None else np.diag(np.diag(self.k)[:2])
        self._image = focal @ plane

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
            b, w = motions[number, :3], motions[number, 3:]
            # The projection's derivative at X = z ray: the translation is divided by z, the rotation is not.
            moving = b / depth[seen].astype(np.float64)[:, None] + se3.cross(w, self._rays[seen])
            out[seen] = np.einsum("nij,nj->ni", self._image[seen], moving)
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
