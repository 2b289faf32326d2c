"""Ground truth for one camera from poses, depth and ids: pure functions of arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from evis.geometry import pinhole, se3
from evis.geometry.distortion import Lens, unproject
from evis.warp_start import start_warp
from nodes.labeler import kernels

start_warp()


def crop(image: np.ndarray, margin: int) -> np.ndarray:
    """Leaves out the over-render margin of images [E, H + 2 margin, W + 2 margin, ...], as a view."""
    return image[:, margin:-margin, margin:-margin] if margin else image


def lens_of(model: str, coefficients: np.ndarray) -> Lens | None:
    """Makes the lens that CameraInfo describes, None for a pinhole. Raises ValueError for an unknown model."""
    straight = model == "plumb_bob" and not np.any(coefficients)
    return None if straight or model == "none" else Lens.of(model, np.asarray(coefficients).tolist())


class FlowField:
    """Computes the forward optical flow [px/s] of rigid bodies, exact at the stamp.

    A surface point X (camera frame) of body i moves relative to the camera with X' = b_i + w_i x X, where w_i is the
    body's angular velocity relative to the camera and b_i the velocity that the body, thought to go on, has at the
    camera's centre. The image velocity is the derivative of the projection, (5.16) in Ma et al., An Invitation to 3-D
    Vision; nothing is differenced.

    """

    def __init__(
        self, k: np.ndarray, size: tuple[int, int], bodies: Sequence[int], camera: int, lens: Lens | None = None
    ) -> None:
        """Looks at the lens once, for every pixel.

        Args:
            k: float64 [3, 3] px, of the image without margin.
            size: (width, height) px.
            bodies: for every id, 0 (background) first, the index of its body in the state, -1 for the static world.
            camera: index of the camera's body.
            lens: its distortion, None for a pinhole.
        """
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
        self._on_rays = _array(np.ascontiguousarray(self._rays), wp.vec3d)
        self._derivative = _array(np.ascontiguousarray(focal @ plane), wp.vec3d)

    def motions(self, pose: np.ndarray, twist: np.ndarray) -> np.ndarray:
        """Computes (b, w) of every id in the camera frame, float64 [ids, 6], for poses [N, 7] and twists [N, 6]."""
        centre, turn = pose[self.camera, :3], se3.conjugate(pose[self.camera, 3:])
        pose, twist = (np.concatenate((a, [still])) for a, still in ((pose, se3.IDENTITY), (twist, np.zeros(6))))
        v, omega = twist[self.bodies, :3], twist[self.bodies, 3:]
        at_camera = v + se3.cross(omega, centre - pose[self.bodies, :3])
        relative = (at_camera - twist[self.camera, :3], omega - twist[self.camera, 3:])
        return np.concatenate([se3.rotate(turn, a) for a in relative], axis=-1)

    def __call__(
        self, pose: np.ndarray, twist: np.ndarray, depth: np.ndarray, ids: np.ndarray, out: np.ndarray
    ) -> np.ndarray:
        """Writes the flow of an image.

        Args:
            pose: float64 [N, 7] of the bodies, to the world.
            twist: float64 [N, 6] of the bodies, m/s and rad/s, world frame.
            depth: float32 [H, W] m.
            ids: int32 [H, W].
            out: float32 [H, W, 2] px/s, which is given back; NaN where depth is not finite.

        Raises ValueError for an id that has no body.
        """
        if ids.size and not 0 <= int(ids.min()) <= int(ids.max()) < len(self.bodies):
            raise ValueError(f"ids run from {ids.min()} to {ids.max()}, CameraInfo names {len(self.bodies)}")
        motions = self.motions(pose, twist).reshape(-1, 2, 3)
        given = [
            self._on_rays, self._derivative, _array(motions, wp.vec3d), _array(depth, wp.float32), _array(ids, wp.int32)
        ]  # fmt: skip
        wp.launch(kernels.flow_of_pixels, ids.shape, given, [_array(out, wp.float32)], device="cpu")
        return out


def boxes(ids: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Finds the visible extent of every instance in ids int32 [E, H, W], the background left out.

    Returns float32 [B, 4] (x0, y0, x1, y1, inclusive pixels), int32 [B] environment and int32 [B] id, by environment
    and then id.
    """
    count = int(ids.max(initial=0)) + 1
    least = np.full((len(ids), count, 2), np.iinfo(np.int32).max, np.int32)
    most = np.full_like(least, -1)
    if ids.size:
        given = _array(np.ascontiguousarray(ids), wp.int32)
        found = [_array(least, wp.int32), _array(most, wp.int32)]
        wp.launch(kernels.extents, ids.shape[:2], [given], found, device="cpu")
    env, number = np.nonzero(most[:, 1:, 0] >= 0)
    box = np.concatenate((least[env, number + 1], most[env, number + 1]), axis=1).astype(np.float32)
    return box, env.astype(np.int32), (number + 1).astype(np.int32)


def _array(values: np.ndarray, dtype: Any) -> wp.array:
    """The same memory for a kernel, with its strides."""
    return wp.array(values, dtype=dtype, device="cpu", copy=False)
